// Finds points at equal coordinates: vertices that a file repeats, such as those at seams of its texture.
#pragma once

#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"

namespace tessera {

// Not thread-safe. Memory: 32 to 40 bytes a different position.
class PositionIndex {
 public:
  // The number of the position: equal positions have the same number, a new one gets the next, from 0 on. Coordinates
  // are finite; 0 equals -0. At most 2^32 - 1 different positions.
  uint32_t NumberOf(const Eigen::Vector3d& position);
  // By number.
  const std::vector<Eigen::Vector3d>& positions() const { return positions_; }

 private:
  void Grow();

  std::vector<Eigen::Vector3d> positions_;
  std::vector<uint32_t> slots_;  // open addressing: number + 1, 0: free; the size is a power of two
};

}  // namespace tessera
