// What the fit of a scene is measured with: points of the surface, pairs of images that see them, and these images.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/geometry/mesh.h"
#include "common/geometry/ray_caster.h"
#include "common/scene/fit.h"
#include "common/scene/patch_match.h"
#include "common/scene/scene.h"

namespace tessera {

// Points spread evenly over the area of the mesh, in the order of its faces: about `count`.
std::vector<SurfacePoint> SpreadPoints(const MeshSpans& mesh, size_t count);

// More for more images, so that each sees enough of them.
size_t FitPointsFor(const SceneDescription& scene);

struct FitPair {
  int reference = 0, other = 0;
  std::vector<uint32_t> points;  // seen by both
};

// About options.pairs pairs, by reference. A point is seen if `caster` meets nothing between it and a camera, farther
// than `margin_m` from it. The result does not depend on the number of threads. CANCELLED by `control`.
StatusOr<std::vector<FitPair>> FindFitPairs(const SceneDescription& scene, const std::vector<SurfacePoint>& points,
                                            const RayCaster& caster, double margin_m, const FitOptions& options,
                                            const TaskControl& control);

struct FitImage {
  FloatImage luminance;
  PatchView view;    // of luminance
  double scale = 1;  // pixels of the file per pixel of luminance: a power of two
};

// The images of the last pairs.
class FitImages {
 public:
  // Images are halved until they have at most `largest_pixels`. `scene` must outlive the object.
  explicit FitImages(const SceneDescription& scene, int64_t largest_pixels = 12'000'000)
      : scene_(scene), largest_pixels_(largest_pixels) {}

  // Reads missing ones at once, on all threads, and drops the others.
  Status Require(const std::set<int>& views);
  const FitImage& at(int view) const { return *loaded_.at(view); }

 private:
  StatusOr<std::unique_ptr<const FitImage>> Load(int view) const;

  const SceneDescription& scene_;
  const int64_t largest_pixels_;
  std::map<int, std::unique_ptr<const FitImage>> loaded_;
};

// What the patches of a pair say.
struct FitMatch {
  SurfacePoint point;
  PatchMatch match;
};
struct FitMatches {
  int reference = 0, other = 0;
  double scale = 1;  // pixels of the reference's file per pixel of the matches
  std::vector<FitMatch> matches;
};

// Calls `measure`(i) for each pair i, with its images read. Reports progress from 0 to 1.
template <class Measure>
Status ForEachFitPair(const std::vector<FitPair>& pairs, FitImages* images, const TaskControl& control,
                      const Measure& measure) {
  for (size_t first = 0, last = 0; first < pairs.size(); first = last) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    std::set<int> views;
    for (; last < pairs.size() && pairs[last].reference == pairs[first].reference; ++last) {
      views.insert({pairs[last].reference, pairs[last].other});
    }
    TESSERA_RETURN_IF_ERROR(images->Require(views));
    for (size_t p = first; p < last; ++p) measure(p);
    control.Report(static_cast<double>(last) / static_cast<double>(pairs.size()), "fit of images and mesh");
  }
  return absl::OkStatus();
}

// The ZNCC that 5 % of patches at random places exceed. 1 without patches.
double ChanceLimit(const std::vector<FitMatches>& pairs);

// The fit that these pairs show.
SceneFit SumUpFit(const SceneDescription& scene, const std::vector<FitMatches>& pairs);

}  // namespace tessera
