// Which views see a mesh, and how much of it is seen.
#ifndef TESSERA_COMMON_SCENE_COVERAGE_H_
#define TESSERA_COMMON_SCENE_COVERAGE_H_

#include <cstdint>
#include <vector>

#include "common/base/task_control.h"
#include "common/geometry/mesh.h"
#include "common/scene/scene.h"

namespace tessera {

enum class ViewSight { kGood, kNothing, kBehindMesh };

struct Coverage {
  std::vector<ViewSight>
      views;  // kNothing: no face in the frustum; kBehindMesh: most of what it sees are backs of faces
  int64_t faces_tried = 0;
  int64_t unseen = 0;       // of those: seen by no view
  int64_t under_three = 0;  // of those: seen by fewer than three, unseen ones included
};

// Ray casts of a grid of pixels of each view and of the centroids of at most `largest_sample` faces (every n-th). The
// same for every number of threads.
StatusOr<Coverage> MeasureCoverage(const SceneDescription& scene, const TriangleMesh& mesh, int64_t largest_sample,
                                   const TaskControl& control);

}  // namespace tessera

#endif  // TESSERA_COMMON_SCENE_COVERAGE_H_
