// What is wrong with a scene whose images, poses and mesh do not fit: the usual mistakes of export are undone one by
// one and the fit is measured again.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/check/fit.h"
#include "common/scene/scene.h"

namespace tessera {

struct Reading {
  std::string fault;        // what the scene would have wrong; empty: no reading fits
  double above_chance = 0;  // with it corrected
  // Of the mesh, local frame: with it, significantly more patches match. Zero: no shift helps. It may explain a scene
  // that fits, too.
  Eigen::Vector3d mesh_shift_m = Eigen::Vector3d::Zero();
};

// What is looked for, beside maps of the mesh that keep its up direction.
struct ReadingSearch {
  bool all = false;    // any mistake: the scene fits badly
  bool shift = false;  // of the mesh
};

// The reading under which most patches correlate, if they are significantly more and it fits at all: another unit or
// other axes of the mesh, its faces oriented inwards, an offset of the mesh, poses that are camera-to-world, of OpenGL,
// or with quaternions in another order, a principal point that is missing, focal lengths that are up to 3 % wrong,
// photographs that are turned. `gsd_m` may be 0 if no camera sees the mesh. A mesh that is turned about the vertical,
// or mirrored, is looked for in a scene that fits, too: flat ground matches under all these maps. For all mistakes, it
// costs about as much as a MeasureFit of each image of a large scene, else less than one MeasureFit. `fetch`: as
// InspectedFiles.
StatusOr<Reading> FindReading(const SceneDescription& scene, const FitSurface& surface, const SceneFit& fit,
                              double gsd_m, const ReadingSearch& search, const TaskControl& control,
                              const FetchFiles& fetch = {});

}  // namespace tessera
