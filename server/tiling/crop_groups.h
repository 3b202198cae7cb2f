// Tiles whose images one task crops. An image shows many tiles, and decoding it takes longer than copying windows of
// it. So tiles share the task that decodes it.
#pragma once

#include <cstdint>
#include <vector>

#include "common/job/survey.h"
#include "server/settings/job_settings.h"
#include "server/tiling/cost_model.h"

namespace tessera {

// Bound on the predicted crops of several tiles: a worker that runs a task of one of these tiles fetches them all.
inline constexpr int64_t kMaxCropGroupBytes = int64_t{2} << 30;
// Bound on the predicted memory of the task: 1 GiB, or less by JobSettings::tile_memory_bytes.
int64_t MaxCropGroupPeak_bytes(const JobSettings& settings);

struct CropGroup {
  std::vector<int> tiles;  // ascending
  TileWork work;           // of PredictCrop: that of the only tile, or of the views of all
};

struct CroppedTile {
  int tile = 0;
  const TileWork* work = nullptr;
};

// Groups tiles that follow each other, which mostly are neighbours. Each group has one tile or keeps both bounds.
std::vector<CropGroup> CropGroupsOf(const Survey& survey, const std::vector<CroppedTile>& tiles,
                                    int64_t max_peak_bytes);

// The tile's share of the prediction for its group. `has_fine_part`: with the crop of the fine part (JobPart).
Prediction ShareOfCrop(const CropGroup& group, bool has_fine_part);

}  // namespace tessera
