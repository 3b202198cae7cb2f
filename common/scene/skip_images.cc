#include "common/scene/skip_images.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace tessera {
namespace {

constexpr size_t kMaxShown = 20;
constexpr double kUsualShare = 0.1, kLargestAdvised = 0.5, kRoundingShare = 1e-9;

std::string ReasonOf(const Status& fault) {
  const std::vector<InputFault> parts = FaultsOf(fault);
  if (parts.empty()) return std::string(fault.message());
  return absl::StrCat(parts.front().location, parts.front().location.empty() ? "" : ": ", parts.front().found);
}

}  // namespace

Status SkipImages(const std::vector<Status>& faults, double share, Warnings* warnings, SceneDescription* scene) {
  const size_t images = scene->views.size() + scene->skipped.size();
  std::vector<SkippedImage> skipped;
  for (size_t i = 0; i < faults.size(); ++i) {
    if (!faults[i].ok()) skipped.push_back({scene->views[i].name, ReasonOf(faults[i])});
  }
  if (skipped.empty()) return absl::OkStatus();
  const size_t total = skipped.size() + scene->skipped.size();
  if (static_cast<double>(total) > (share + kRoundingShare) * static_cast<double>(images) || total == images) {
    scene->unusable_images += static_cast<int64_t>(skipped.size());
    return InputError(scene->folder, "images", absl::StrCat(total, " of ", images, " missing or broken"),
                      absl::StrCat("at most ", 100 * share, " % (--skip-images)"));
  }
  if (warnings != nullptr) {
    std::vector<std::string> shown;
    for (size_t i = 0; i < std::min(skipped.size(), kMaxShown); ++i) {
      shown.push_back(absl::StrCat(skipped[i].name, " (", skipped[i].reason, ")"));
    }
    if (skipped.size() > kMaxShown) shown.push_back(absl::StrCat("and ", skipped.size() - kMaxShown, " more"));
    warnings->push_back(absl::StrCat(skipped.size(), " of ", images, " images are left out: ",
                                     absl::StrJoin(shown, ", ")));
  }
  scene->skipped.insert(scene->skipped.end(), skipped.begin(), skipped.end());
  KeepUsable(faults, &scene->views);
  return absl::OkStatus();
}

Status SkipAdvice(const SceneDescription& scene) {
  const double images = static_cast<double>(scene.views.size() + scene.skipped.size());
  const double share =
      std::max(kUsualShare, std::ceil(100 * static_cast<double>(scene.unusable_images) / images) / 100);
  if (scene.unusable_images == 0 || share > kLargestAdvised) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("to leave out the ", scene.unusable_images,
                                                 " missing or broken images: --skip-images ", share));
}

}  // namespace tessera
