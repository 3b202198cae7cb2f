// Order of points along a space-filling curve, so that what lies close together in space does so in memory.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <vector>

#include "common/base/parallel.h"

namespace tessera {

// Position of each point along a Morton curve through the points' bounding box.
inline std::vector<uint64_t> MortonKeys(const std::vector<Eigen::Vector3d>& points) {
  // Inserts two zero bits between the low 21 bits of x.
  const auto spread = [](double value) {
    uint64_t x = static_cast<uint64_t>(value) & 0x1fffff;
    x = (x | x << 32) & 0x1f00000000ffff;
    x = (x | x << 16) & 0x1f0000ff0000ff;
    x = (x | x << 8) & 0x100f00f00f00f00f;
    x = (x | x << 4) & 0x10c30c30c30c30c3;
    return (x | x << 2) & 0x1249249249249249;
  };
  std::vector<uint64_t> keys;
  if (points.empty()) return keys;
  Eigen::Vector3d low = points[0], high = low;
  for (const Eigen::Vector3d& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double scale = 2097151 / std::max(1e-9, (high - low).maxCoeff());
  keys.resize(points.size());
  ParallelForEach(points.size(), 8192, [&](size_t i) {
    const Eigen::Vector3d at = (points[i] - low) * scale;
    keys[i] = spread(at.x()) | spread(at.y()) << 1 | spread(at.z()) << 2;
  });
  return keys;
}

}  // namespace tessera
