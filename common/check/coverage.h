// Visibility of a mesh in the views of a scene.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdint>
#include <vector>

#include "common/base/task_control.h"
#include "common/geometry/mesh.h"
#include "common/scene/scene.h"

namespace tessera {

enum class ViewVisibility { kGood, kNothing, kBehindMesh };

struct Coverage {
  std::vector<ViewVisibility>
      views;                // kNothing: no face in the frustum; kBehindMesh: most of what it sees are backs of faces
  int64_t faces_tried = 0;  // sampled faces
  int64_t unseen = 0;       // sampled faces that no view sees
  int64_t under_three = 0;  // sampled faces that fewer than three views see, including unseen ones
  Eigen::AlignedBox3d box;  // of the mesh
};

// Casts rays through a grid of pixels of each view, and to the centroids of at most `largest_sample` faces (every
// n-th). The result does not depend on the number of threads.
StatusOr<Coverage> MeasureCoverage(const SceneDescription& scene, const TriangleMesh& mesh, int64_t largest_sample,
                                   const TaskControl& control);

// Whether each view sees the front of the mesh.
inline bool AllViewsSee(const Coverage& coverage) {
  return std::count(coverage.views.begin(), coverage.views.end(), ViewVisibility::kGood) ==
         static_cast<int64_t>(coverage.views.size());
}

// Adds an error for each view that sees no face, or mostly backs of faces, of the scene's mesh. If almost all views see
// nothing, or backs, one error for all.
void AddVisibilityFaults(const SceneDescription& scene, const Coverage& coverage, Faults* faults);

}  // namespace tessera
