// Where refining broke a surface: faces that turned over, faces that cut through each other.
#ifndef TESSERA_TESTS_BENCH_SURFACE_FOLDS_H_
#define TESSERA_TESTS_BENCH_SURFACE_FOLDS_H_

#include <array>
#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"

namespace tessera {

struct SurfaceFolds {
  int64_t turned_faces = 0;    // whose normal points against the smoothed start's
  int64_t crossing_pairs = 0;  // of faces that cut each other and did not in the start
};

// Compares meshes with one start of the same topology, which must be an oriented manifold. The smoothed start is the
// start after kSmoothingSteps umbrella steps of half length, mesh rims still.
class FoldCounter {
 public:
  static constexpr int kSmoothingSteps = 5;  // as MotionLimits
  static StatusOr<FoldCounter> Create(const TriangleMesh& start);
  StatusOr<SurfaceFolds> Count(const TriangleMesh& mesh) const;

 private:
  std::vector<Eigen::Vector3d> smoothed_normals_;
  std::vector<std::array<uint32_t, 2>> start_pairs_;
};

}  // namespace tessera

#endif  // TESSERA_TESTS_BENCH_SURFACE_FOLDS_H_
