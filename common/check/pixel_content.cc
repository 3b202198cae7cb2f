#include "common/check/pixel_content.h"

#include <cmath>
#include <map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/imaging/undistort.h"
#include "common/scene/photographs.h"
#include "common/storage/hash.h"

namespace tessera {
namespace {

int64_t CountNan(const FloatImage& image) {
  return std::count_if(image.data.begin(), image.data.end(), [](float value) { return std::isnan(value); });
}

// The share of the photograph's pixels that `luminance`, which was read with a mask, lacks.
double MaskedShare(const FloatImage& luminance, const LensModel& lens) {
  const ImagePart whole = {0, 0, luminance.width, luminance.height};
  const FloatImage unmasked =
      UndistortPart(FloatImage(luminance.width, luminance.height, 1, 1.0f), whole, lens, whole, NAN);
  const auto inside = static_cast<int64_t>(luminance.plane_size()) - CountNan(unmasked);
  const int64_t masked = CountNan(luminance) - CountNan(unmasked);
  return inside > 0 ? static_cast<double>(masked) / static_cast<double>(inside) : 0;
}

}  // namespace

void WarnOfContents(const SceneDescription& scene, const std::vector<PixelContent>& contents, Warnings* warnings) {
  int64_t masked = 0;
  double share = 0;
  std::map<std::string, size_t> first_of_content;
  int64_t copies = 0, other_poses = 0;
  std::string example;
  for (size_t v = 0; v < contents.size(); ++v) {
    const PixelContent& content = contents[v];
    masked += content.masked_share > 0;
    share += content.masked_share;
    if (content.image.empty()) continue;
    const auto [first, is_new] = first_of_content.emplace(content.image, v);
    if (is_new) continue;
    const SceneView &a = scene.views[first->second], &b = scene.views[v];
    const bool other_pose = !(a.camera == b.camera);
    if (copies++ == 0 || (other_pose && other_poses == 0)) {
      example = absl::StrCat("'", a.name, "' and '", b.name, "'");
    }
    other_poses += other_pose;
  }
  if (masked > 0) {
    warnings->push_back(
        absl::StrFormat("%d images have a mask or transparent pixels: %.1f %% of their pixels "
                        "are not used",
                        masked, 100 * share / static_cast<double>(masked)));
  }
  if (copies > 0) {
    warnings->push_back(absl::StrCat(
        copies, copies == 1 ? " image has" : " images have", " the same pixels as another one, such as ", example, ": ",
        other_poses > 0
            ? absl::StrCat(other_poses, " of these pairs have different poses, of which one must be wrong; ")
            : "",
        "remove the copies"));
  }
}

StatusOr<PixelContent> ReadPixelContent(const std::string& folder, const SceneView& view, int classes,
                                        BorderCounts* borders, LikelihoodDigest* digest, Status* broken) {
  PixelContent content;
  Faults faults;
  const auto take = [&faults](StatusOr<FloatImage> image, std::string* hash) -> FloatImage {
    faults.Add(image.status());
    if (!image.ok()) return {};
    *hash = Xxh3Hex(image->data.data(), image->data.size() * sizeof(float));
    return *std::move(image);
  };
  FloatImage luminance;
  if (!view.image_path.empty()) {
    luminance = take(ReadLuminance(absl::StrCat(folder, "/", view.image_path), view.lens, OptionsOf(folder, view)),
                     &content.image);
    if (broken != nullptr && !faults.empty()) {
      *broken = faults.ToStatus();
      return PixelContent();
    }
    if (view.masked && !luminance.empty()) content.masked_share = MaskedShare(luminance, view.lens);
  }
  if (!view.likelihood_path.empty()) {
    if (borders == nullptr) luminance = FloatImage();  // release the image before the likelihoods are read
    const ImagePart all = {0, 0, view.lens.pinhole.width, view.lens.pinhole.height};
    StatusOr<LikelihoodPart> whole = ReadLikelihoodPart(absl::StrCat(folder, "/", view.likelihood_path), classes,
                                                        view.lens, all, view.likelihood_form);
    if (whole.ok() && digest != nullptr) *digest = DigestOf(*whole);
    const FloatImage likelihoods =
        take(whole.ok() ? StatusOr<FloatImage>(std::move(whole->pixels)) : whole.status(), &content.likelihood);
    if (borders != nullptr) borders->Add(luminance, likelihoods);
  }
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return content;
}

}  // namespace tessera
