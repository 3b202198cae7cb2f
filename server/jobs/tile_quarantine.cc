#include "server/jobs/tile_quarantine.h"

#include <algorithm>
#include <set>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "common/job/task_kinds.h"

namespace tessera {
namespace {

bool IsStepOfTile(const PlannedTask& plan) { return plan.tile >= 0 && KindOf(plan.kind.str()).can_quarantine; }

bool SameTask(const PlannedTask& a, const PlannedTask& b) {
  const auto same_input = [](const PlannedInput& x, const PlannedInput& y) {
    return x.task == y.task && x.output == y.output && x.tile == y.tile;
  };
  return a.kind == b.kind && a.parameters == b.parameters && *a.scene_files == *b.scene_files &&
         *a.view_files == *b.view_files &&
         std::equal(a.inputs.begin(), a.inputs.end(), b.inputs.begin(), b.inputs.end(), same_input);
}

}  // namespace

bool CanContinueWithout(const Job& job) {
  const JobTask& failed = job.tasks[job.failed];
  const ErrorClass error_class = failed.error->error_class;
  if (error_class == ErrorClass::kInput || error_class == ErrorClass::kStorage || !IsStepOfTile(failed.plan))
    return false;
  std::set<int> cut, quarantined = {failed.plan.tile};
  for (const JobTask& task : job.tasks) {
    if (task.plan.kind == kCutKind) cut.insert(task.plan.tile);
  }
  for (const QuarantinedTile& each : job.quarantined) quarantined.insert(each.tile);
  return quarantined.size() < cut.size();
}

std::vector<FailedTile> QuarantinedTiles(const Job& job) {
  std::vector<FailedTile> tiles;
  for (const QuarantinedTile& each : job.quarantined) tiles.push_back(FailedTileOf(job, each));
  return tiles;
}

std::string QuarantineText(const Job& job, const QuarantinedTile& tile) {
  const JobTask& failed = job.tasks[tile.task];
  return "tile " + std::to_string(tile.tile) + " was quarantined: '" + failed.plan.name + "' failed (" +
         ErrorClassName(failed.error->error_class) + "): " + failed.error->message;
}

// A task stays if name, kind, parameters, files and inputs are equal. Inputs are first renumbered to the tasks that
// stay, so equality propagates through the graph.
PlanChange ChangePlan(int first, const std::vector<KnownTask>& known, std::vector<PlannedTask> tasks) {
  const int end = first + static_cast<int>(known.size());
  std::unordered_map<std::string_view, int> place_of_name;
  for (int i = first; i < end; ++i) {
    if (!known[i - first].superseded) place_of_name[known[i - first].plan.name] = i;
  }
  PlanChange change;
  std::vector<uint8_t> stays(known.size(), 0);
  std::vector<int> place;  // index of each of `tasks` in the job's tasks
  for (PlannedTask& task : tasks) {
    for (PlannedInput& input : task.inputs) {
      if (input.task.value() >= first) input.task = TaskId(place[input.task.value() - first]);
    }
    const auto same = place_of_name.find(task.name);
    if (same != place_of_name.end() && SameTask(known[same->second - first].plan, task)) {
      place.push_back(same->second);
      stays[same->second - first] = 1;
    } else {
      place.push_back(end + static_cast<int>(change.added.size()));
      change.added.push_back(std::move(task));
    }
  }
  for (int i = first; i < end; ++i) {
    if (!stays[i - first] && !known[i - first].superseded) change.superseded.push_back(i);
  }
  return change;
}

}  // namespace tessera
