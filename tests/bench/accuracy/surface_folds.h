// Where refining broke a surface: faces that turned over, faces that cut through each other.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "worker/refine/descent.h"
#include "worker/refine/self_intersection.h"

namespace tessera {

struct SurfaceFolds {
  int64_t turned_faces = 0;    // whose normal points against the smoothed start's
  int64_t crossing_pairs = 0;  // of faces that cut each other and did not in the start
};

// Compares meshes with one start of the same topology, which must be an oriented manifold. The smoothed start is
// MotionGuard's; crossings are found by CGAL, not by the search that the refinement uses.
class FoldCounter {
 public:
  static StatusOr<FoldCounter> Create(const TriangleMesh& start);
  StatusOr<SurfaceFolds> Count(const TriangleMesh& mesh) const;

 private:
  FoldCounter(const TriangleMesh& start, std::vector<FacePair> pairs)
      : guard_(start, {}, MotionLimits()), start_pairs_(std::move(pairs)) {}

  MotionGuard guard_;
  std::vector<FacePair> start_pairs_;
};

}  // namespace tessera
