#include "common/importing/rim_welder.h"

#include <cmath>

#include "common/base/random.h"
#include "common/geometry/position_index.h"

namespace tessera {

std::vector<bool> RimVertices(const MeshSpans& mesh) {
  PositionIndex positions;
  std::vector<uint32_t> numbers(mesh.vertices.size());
  for (size_t v = 0; v < numbers.size(); ++v) numbers[v] = positions.NumberOf(mesh.vertices[v]);
  // Sums of hashes over the directed edges: an edge from a to b adds the hash of b at a, and takes the hash of a away
  // at b. Edges with a face on both sides cancel at both ends.
  std::vector<uint64_t> sums(positions.positions().size());
  for (const Triangle& face : mesh.faces) {
    for (size_t k = 0; k < 3; ++k) {
      const uint32_t a = numbers[face[k]], b = numbers[face[(k + 1) % 3]];
      sums[a] += MixBits(b);
      sums[b] -= MixBits(a);
    }
  }
  std::vector<bool> is_rim(numbers.size());
  for (size_t v = 0; v < numbers.size(); ++v) is_rim[v] = sums[numbers[v]] != 0;
  return is_rim;
}

uint64_t RimWelder::CellOf(const Eigen::Vector3d& position, const std::array<int, 3>& step) const {
  uint64_t hash = 0;
  for (int k = 0; k < 3; ++k) {
    const auto cell = static_cast<int64_t>(std::floor(position[k] / distance_m_)) + step[static_cast<size_t>(k)];
    hash = MixBits(hash ^ static_cast<uint64_t>(cell));
  }
  return hash;
}

uint32_t RimWelder::Find(const Eigen::Vector3d& position) const {
  uint32_t closest = kNone;
  double least = distance_m_ * distance_m_;
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        const auto cell = cells_.find(CellOf(position, {x, y, z}));
        if (cell == cells_.end()) continue;
        for (uint32_t r = cell->second; r != kNone; r = rims_[r].next) {
          const double distance = (rims_[r].position - position).squaredNorm();
          if (distance > least || (distance == least && rims_[r].number >= closest)) continue;
          least = distance;
          closest = rims_[r].number;
        }
      }
    }
  }
  return closest;
}

void RimWelder::Add(const Eigen::Vector3d& position, uint32_t number) {
  const auto rim = static_cast<uint32_t>(rims_.size());
  const auto [cell, is_new] = cells_.try_emplace(CellOf(position, {0, 0, 0}), rim);
  rims_.push_back({position, number, is_new ? kNone : cell->second});
  cell->second = rim;
}

}  // namespace tessera
