// Closes the borders between tiles of a mesh: finds the vertices of earlier tiles that vertices on a tile's rim repeat.
#pragma once

#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "common/geometry/mesh.h"

namespace tessera {

// Which vertices lie on edges with one face. Vertices at equal positions count as one, so that neither a triangle soup
// nor seams of textures are rims. Edges whose two faces run through them in the same direction count as rims too.
std::vector<bool> RimVertices(const MeshSpans& mesh);

// Takes the tiles of a mesh one after the other. Not thread-safe. Memory: about 100 bytes a rim vertex.
class RimWelder {
 public:
  static constexpr uint32_t kNone = 0xffffffff;

  // Vertices are merged up to this distance, > 0, in metres.
  explicit RimWelder(double distance_m) : distance_m_(distance_m) {}

  // The number of the closest rim vertex of earlier tiles within the distance; the lowest of several; kNone.
  // Coordinates are at most kMaxCoordinate.
  uint32_t Find(const Eigen::Vector3d& position) const;
  // Adds rim vertices of a tile, after all its vertices were looked up; so vertices of one tile stay apart.
  void Add(const Eigen::Vector3d& position, uint32_t number);

  static constexpr double kMaxCoordinate = 1e9;

 private:
  struct Rim {
    Eigen::Vector3d position;
    uint32_t number;
    uint32_t next;  // in the same cell; kNone: the last
  };
  uint64_t CellOf(const Eigen::Vector3d& position, const std::array<int, 3>& step) const;

  double distance_m_;
  std::vector<Rim> rims_;
  std::unordered_map<uint64_t, uint32_t> cells_;  // first of rims_, by the hash of the cell
};

}  // namespace tessera
