#include "server/plan/crop_tasks.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/plan/stages.h"
#include "server/tiling/crop_groups.h"

namespace tessera {
namespace {

// The tiles of each task. Groups are made of all tiles, so that quarantined ones change no other group.
std::vector<CropGroup> GroupsToCrop(const CropWork& work, const std::vector<GraphTile>& tiles) {
  std::vector<CroppedTile> candidates;
  for (const GraphTile& tile : tiles) {
    if (tile.redone) candidates.push_back({tile.parameters.tile, &tile.work});
  }
  std::vector<CropGroup> tasks;
  for (CropGroup& group : CropGroupsOf(work.survey, candidates, work.max_peak_bytes)) {
    const auto any = [&](const auto& is) {
      return std::any_of(group.tiles.begin(), group.tiles.end(), [&](int tile) { return is(tiles[tile]); });
    };
    const bool failed = any([](const GraphTile& tile) { return tile.crop_failed; });
    std::erase_if(group.tiles, [&](int tile) { return tiles[tile].frozen_from == kNoCut || tiles[tile].crop_failed; });
    // A tile that is quarantined later on stays in its group, so that the group keeps its crops.
    if (!any([](const GraphTile& tile) { return !tile.never_started(); })) continue;
    if (!failed) {
      tasks.push_back(std::move(group));
      continue;
    }
    // One of the tiles may be the cause, and not the quarantined one.
    for (const int tile : group.tiles) tasks.push_back({{tile}, tiles[tile].work});
  }
  return tasks;
}

}  // namespace

std::vector<PlannedTask> PlanCrops(const CropWork& work, std::vector<GraphTile>* tiles) {
  std::vector<PlannedTask> tasks;
  for (const CropGroup& group : GroupsToCrop(work, *tiles)) {
    PlannedTask task;
    CropParameters parameters;
    parameters.tiles = group.tiles;
    std::set<int32_t> views;
    std::map<TaskId, int> coarse;  // tile under whose name each task's crops are read
    for (const int id : group.tiles) {
      GraphTile& tile = (*tiles)[id];
      views.insert(tile.work.views.begin(), tile.work.views.end());
      task.inputs.push_back({tile.cut, kTileFile, id});
      if (tile.coarse_crop) {
        const auto [found, is_new] = coarse.try_emplace(tile.coarse_crop->task, id);
        if (is_new) task.inputs.push_back(*tile.coarse_crop);
        parameters.coarse.push_back(found->second);
      }
      tile.crop = TaskId(static_cast<int>(work.first_task + tasks.size()));
    }
    if (parameters.coarse.size() != parameters.tiles.size()) parameters.coarse.clear();
    const int first = group.tiles.front(), last = group.tiles.back();
    task.kind = kCropKind;
    task.tile = first;
    task.name = first == last ? absl::StrCat(kCropKind, " tile ", first)
                              : absl::StrCat(kCropKind, " tiles ", first, " to ", last);
    task.parameters = ToJson(parameters);
    SetCost(parameters.coarse.empty() ? PredictCrop(group.work) : PredictFineCrop(group.work), &task);
    for (const int32_t view : views) {
      const std::vector<PlannedTask::ViewFile>& files = work.files_of_view[view];
      task.view_files.Edit().insert(task.view_files->end(), files.begin(), files.end());
      if (work.classified[view]) task.inputs.push_back(*work.classified[view]);
    }
    tasks.push_back(std::move(task));
  }
  return tasks;
}

std::map<int, TaskId> CropsByTile(const PlannedTask& task, TaskId id) {
  std::map<int, TaskId> crops;
  if (task.kind != kCropKind) return crops;
  if (const auto parameters = ParseCropParameters(task.parameters); parameters.ok()) {
    for (const int tile : parameters->tiles) crops.emplace(tile, id);
  }
  return crops;
}

}  // namespace tessera
