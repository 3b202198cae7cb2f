// Residuals of tie points in the photographs of a block: what the proof measures.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/blocks/block.h"

namespace tessera {

// Of residuals in pixels of the photographs. Infinite if so many points are behind their cameras.
struct ResidualSummary {
  double median_px = 0, p95_px = 0;
  int64_t observations = 0;
};

ResidualSummary SummariseResiduals(std::vector<float> residuals_px);

// Whether the source has a position of the point: it is finite and not (0, 0, 0).
bool HasPosition(const BlockTiePoint& point);

// The position, in the block's coordinates, that fits the observations of the point best: from the rays, then three
// Gauss-Newton steps on the residuals. None if fewer than two oriented images observe it, if their rays are parallel
// within 1e-4 rad, or if it would lie behind one of them.
std::optional<Eigen::Vector3d> TriangulatePoint(const ImportedBlock& block, const BlockTiePoint& point);

// The distance from each observation to the projection of its point, pixels, in the order of points and observations.
// Infinite behind the camera, NaN in an image without a pose or a camera. Points without a position are triangulated
// first; the residuals of those that cannot be are infinite. The block's coordinates must be Cartesian: neither degrees
// nor a map projection if it was adjusted in space.
std::vector<float> ResidualsOf(const ImportedBlock& block, const std::vector<BlockTiePoint>& points);

}  // namespace tessera
