#include "server/tiling/crop_groups.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace tessera {
namespace {

// What PredictCrop reads, for the views of both.
TileWork JointWork(const Survey& survey, const TileWork& a, const TileWork& b) {
  TileWork out;
  out.visible_faces = std::max(a.visible_faces, b.visible_faces);  // one package is in memory at a time
  std::set_union(a.views.begin(), a.views.end(), b.views.begin(), b.views.end(), std::back_inserter(out.views));
  double largest_image = 0;
  for (const int32_t view : out.views) {
    const PinholeCamera& camera = survey.views[view].camera.intrinsics;
    const double pixels = static_cast<double>(camera.width) * camera.height;
    out.image_pixels += pixels;
    largest_image = std::max(largest_image, pixels);
  }
  out.image_pixels = std::min(out.image_pixels, a.image_pixels + b.image_pixels);
  out.pixels = std::min(out.image_pixels, a.pixels + b.pixels);
  out.largest_crop = std::min(a.largest_crop + b.largest_crop, largest_image);
  out.largest_decoded = std::max(a.largest_decoded, b.largest_decoded);
  out.likelihood_planes = std::max(a.likelihood_planes, b.likelihood_planes);
  return out;
}

}  // namespace

int64_t MaxCropGroupPeak_bytes(const JobSettings& settings) {
  constexpr int64_t kMost = int64_t{1} << 30;
  if (settings.tile_memory_bytes == 0) return kMost;
  const double least_limit = static_cast<double>(settings.tile_memory_bytes) / kRefineBytesInterval.high;
  return std::min(kMost, static_cast<int64_t>(least_limit));
}

std::vector<CropGroup> CropGroupsOf(const Survey& survey, const std::vector<CroppedTile>& tiles,
                                    int64_t max_peak_bytes) {
  std::vector<CropGroup> groups;
  for (const auto& [tile, work] : tiles) {
    if (!groups.empty()) {
      TileWork joint = JointWork(survey, groups.back().work, *work);
      const Prediction predicted = PredictCrop(joint);
      if (predicted.stored_bytes <= kMaxCropGroupBytes && predicted.peak_bytes <= max_peak_bytes) {
        groups.back().tiles.push_back(tile);
        groups.back().work = std::move(joint);
        continue;
      }
    }
    groups.push_back({{tile}, *work});
  }
  return groups;
}

Prediction ShareOfCrop(const CropGroup& group, bool has_fine_part) {
  Prediction share = PredictCrop(group.work);
  if (has_fine_part) share += PredictFineCrop(group.work);
  share.core_seconds /= static_cast<double>(group.tiles.size());
  share.stored_bytes /= static_cast<int64_t>(group.tiles.size());
  return share;
}

}  // namespace tessera
