// Whether the refinement of a tile improved the fit of surface and images.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {

// Patches of the surface that two images show, compared through the start and through the refined surface.
struct FitChange {
  int64_t patches = 0;
  int64_t start = 0, result = 0;  // those that correlate better than 95 % of patches at random places
  int64_t lost = 0, gained = 0;   // those whose ZNCC fell, or rose, by more than 0.05

  void Add(const FitChange& other);
  // Whether more patches were lost than chance explains, and more than one in a hundred. If refinement improved
  // nothing, a patch would be lost or gained with equal probability: lost - gained has the standard deviation sqrt(lost
  // + gained), of which four are exceeded once in 30,000 cases.
  bool IsWorse() const;
};

struct TileFit {
  FitChange all;
  std::map<int32_t, FitChange> views;                  // by the view's id in the job
  Eigen::Vector3d centre_m = Eigen::Vector3d::Zero();  // mean of the patches, local frame
};

// Compares the start of the core with `positions` (of all vertices of the package), at the same points of the same
// pairs of images. Deterministic. Without a pair of images: no patches. Errors: those of the pixels; CANCELLED.
StatusOr<TileFit> CompareFit(const TileWorkspace& work, const TileImages& images,
                             const std::vector<Eigen::Vector3d>& positions, const TaskControl& control);

// As part of the tile's report.
std::string ToJson(const TileFit& fit);
// The fit in a tile's report: the value of its key "fit", as JSON. Without patches if the text is not of that form.
TileFit ParseTileFit(const std::string& json);

}  // namespace tessera
