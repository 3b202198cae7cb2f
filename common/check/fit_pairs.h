// What the fit of a scene is measured with: points of the surface, pairs of images that see them, and these images.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/check/fit.h"
#include "common/check/patch_match.h"
#include "common/geometry/mesh.h"
#include "common/geometry/ray_caster.h"
#include "common/scene/scene.h"

namespace tessera {

// Points spread evenly over the area of the mesh, in the order of its faces: about `count`.
std::vector<SurfacePoint> SpreadPoints(const MeshSpans& mesh, size_t count);

// More for more images, so that each sees enough of them.
size_t FitPointsFor(const SceneDescription& scene);

struct FitPair {
  int reference = 0, other = 0;
  std::vector<SurfacePoint> points;  // seen by both
};

// About options.pairs pairs, by reference. A point is seen if `caster` meets nothing between it and a camera, farther
// than `margin_m` from it. The result does not depend on the number of threads. CANCELLED by `control`.
StatusOr<std::vector<FitPair>> FindFitPairs(const SceneDescription& scene, const std::vector<SurfacePoint>& points,
                                            const RayCaster& caster, double margin_m, const FitOptions& options,
                                            const TaskControl& control);

// The images of the last pairs.
class FitImages {
 public:
  // Images are halved until they have at most `largest_pixels`. At most `kept` images stay beside those required last.
  // `scene` must outlive the object. `fetch`: as InspectedFiles.
  explicit FitImages(const SceneDescription& scene, FetchFiles fetch = {}, int64_t largest_pixels = 12'000'000,
                     size_t kept = 0)
      : scene_(scene), fetch_(std::move(fetch)), largest_pixels_(largest_pixels), kept_(kept) {}

  // Makes their files readable.
  Status Fetch(const std::set<int>& views) const;
  // Reads missing ones at once, on all threads. Errors of reading and fetching.
  Status Require(const std::set<int>& views);
  // A required image with the camera that the view has in `scene`: that of the constructor, or one with other cameras.
  PatchView At(const SceneDescription& scene, int view) const;
  double Scale(int view) const { return images_.at(view).scale; }  // pixels of the file per pixel of the image

 private:
  struct Image {
    FloatImage luminance;
    double scale = 1;  // a power of two
  };
  StatusOr<Image> Load(int view) const;

  const SceneDescription& scene_;
  const FetchFiles fetch_;
  const int64_t largest_pixels_;
  const size_t kept_;
  std::map<int, Image> images_;
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
  std::set<int> all;
  for (const FitPair& pair : pairs) all.insert({pair.reference, pair.other});
  TESSERA_RETURN_IF_ERROR(images->Fetch(all));
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

// MatchPatch of each point that the views of a pair see.
std::vector<std::optional<PatchMatch>> MatchPoints(const PatchView& reference, const PatchView& other,
                                                   const std::vector<SurfacePoint>& points, uint32_t seed);

// The ZNCC that 5 % of patches at random places exceed. 1 without patches.
double ChanceLimit(const std::vector<FitMatches>& pairs);

// The fit that these pairs show.
SceneFit SumUpFit(const SceneDescription& scene, const std::vector<FitMatches>& pairs);

}  // namespace tessera
