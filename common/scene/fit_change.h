// Whether images match through the result of a refinement as well as through its start.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/geometry/mesh.h"
#include "common/scene/fit.h"
#include "common/scene/scene.h"

namespace tessera {

// A patch around a pixel of a pair's reference, warped through both meshes.
struct PatchChange {
  int reference = 0, other = 0;          // views
  Eigen::Vector3d position = {0, 0, 0};  // on the start mesh, local frame
  float before = 0, after = 0;           // ZNCC
};

struct FitChange {
  SceneFit start, result;  // of the same patches
  std::vector<PatchChange> patches;
  std::vector<int> worse_views;  // views whose patches became worse
  bool worse = false;            // all patches together became worse
};

// Measures the same pixels of the same pairs through both meshes: a pixel of the reference meets each by its ray.
// Patches that one of the meshes does not allow to compare are left out. Meshes: repaired, local frame, in memory. The
// result does not depend on the number of threads. Errors: those of reading images, and CANCELLED by `control`.
StatusOr<FitChange> CompareFits(const SceneDescription& scene, const TriangleMesh& start, const TriangleMesh& result,
                                const FitOptions& options, const TaskControl& control);

// Whether these patches, of a view, a tile or a scene, became worse: those that correlate clearly less exceed those
// that correlate clearly more by a tenth of all, and by five standard deviations of a sign test. Patches share images
// and pixels: two of them count for one.
bool BecameWorse(std::span<const PatchChange> patches);

}  // namespace tessera
