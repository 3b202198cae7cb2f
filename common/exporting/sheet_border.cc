#include "common/exporting/sheet_border.h"

namespace tessera {
namespace {

// splitmix64 (Steele et al., 2014).
uint64_t MixedBits(uint64_t x) {
  x += 0x9e3779b97f4a7c15;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9;
  x = (x ^ (x >> 27)) * 0x94d049bb133111eb;
  return x ^ (x >> 31);
}

}  // namespace

std::vector<uint8_t> BorderVertices(size_t vertices, std::span<const Triangle> faces) {
  // In a closed fan, each neighbour of the vertex follows it in one face and precedes it in another, so that the sum of
  // its neighbours' hashes with these signs is 0.
  std::vector<uint64_t> sums(vertices);
  std::vector<uint8_t> is_border(vertices, 1);
  for (const Triangle& face : faces) {
    for (int k = 0; k < 3; ++k) {
      sums[face[k]] += MixedBits(face[(k + 1) % 3]) - MixedBits(face[(k + 2) % 3]);
      is_border[face[k]] = 0;
    }
  }
  for (size_t v = 0; v < vertices; ++v) is_border[v] |= sums[v] != 0 ? 1 : 0;
  return is_border;
}

}  // namespace tessera
