#include "server/plan/stages.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/job/task_kinds.h"
#include "server/plan/update_plan.h"

namespace tessera {

int StageOf(const std::string& kind, int step, bool before) {
  const int first = 4 * step;
  if (kind == kMeasureKind) return first + 1;
  if (kind == kSolveKind) return first + 2;
  return before ? first : first + 3;  // mend
}

bool FailedBefore(const FailedTile& a, const FailedTile& b) {
  const auto place = [](const FailedTile& tile) {
    const int stage = tile.kind == kCutKind    ? -2
                      : tile.kind == kCropKind ? -1
                                               : StageOf(tile.kind, tile.step, tile.before);
    return std::pair(tile.fine, stage);
  };
  return place(a) < place(b);
}

std::vector<int> StepsTaken(const JobSettings& settings, const Survey& survey, bool continues_base, JobPart part) {
  std::vector<int> steps = continues_base ? UpdateSteps(settings, survey) : ActiveStepsOf(settings, survey);
  const int first_fine = FirstFineStepOf(settings);
  std::erase_if(steps, [&](int s) { return !IsStepOf(part, s, first_fine); });
  return steps;
}

Status CheckSteps(const JobSettings& settings, const Survey& survey, bool continues_base) {
  if (!StepsTaken(settings, survey, continues_base).empty()) return absl::OkStatus();
  return InputError(survey.scene_name, "likelihoods", "no likelihoods of two or more classes",
                    absl::StrCat("likelihoods, because the method \"", settings.method,
                                 "\" solves labels only; `tessera classify` computes them"));
}

Status CheckReads(const std::vector<TileReads>& reads, size_t cut, size_t tiles) {
  if (cut != reads.size()) {
    return absl::FailedPreconditionError(
        absl::StrCat("cut results: found ", reads.size(), " tiles, expected ", cut, ", as this version plans them"));
  }
  for (const TileReads& of_tile : reads) {
    for (const std::vector<int>* ids : {&of_tile.label, &of_tile.repair, &of_tile.visibility, &of_tile.solve}) {
      for (const int id : *ids) {
        if (id >= 0 && id < static_cast<int>(tiles)) continue;
        return absl::InvalidArgumentError(absl::StrCat("reads: found tile ", id, ", expected an id below ", tiles));
      }
    }
  }
  return absl::OkStatus();
}

std::vector<int> StagesWithGoodStates(const JobSettings& settings, const Survey& survey, bool continues_base) {
  std::vector<int> stages;
  const std::vector<RefineStep> steps = StepsOf(settings);
  bool mended = continues_base && !survey.revision;
  for (const int s : StepsTaken(settings, survey, continues_base)) {
    if (!mended && (continues_base || !steps[s].labels())) {
      stages.push_back(StageOf(kMendKind, s, /*before=*/true));
      mended = true;
    }
    if (steps[s].labels()) stages.push_back(StageOf(kSolveKind, s));
    if (steps[s].ends_level) stages.push_back(StageOf(kMendKind, s));
  }
  return stages;
}

Status FreezeTiles(const std::vector<FailedTile>& failed, const std::vector<int>& good, bool fine,
                   bool from_revised_base, std::vector<GraphTile>* tiles) {
  for (const FailedTile& each : failed) {
    if (each.fine != fine) continue;  // of the other part
    if (each.tile < 0 || each.tile >= static_cast<int>(tiles->size()) || !(*tiles)[each.tile].redone) {
      return absl::FailedPreconditionError(
          absl::StrCat("cannot quarantine tile ", each.tile, ": the job does not refine it"));
    }
    GraphTile& tile = (*tiles)[each.tile];
    tile.frozen_from = FrozenFrom(each, good);
    tile.crop_failed = each.kind == kCropKind;
    if (!tile.never_started() || !from_revised_base) continue;
    return absl::FailedPreconditionError(
        absl::StrCat("tile ", each.tile, " cannot keep the base job's state: the mesh has changed"));
  }
  return absl::OkStatus();
}

int FrozenFrom(const FailedTile& tile, const std::vector<int>& good) {
  if (tile.kind == kCutKind) return kNoCut;
  if (tile.kind == kCropKind) return kNoState;
  const auto next = std::lower_bound(good.begin(), good.end(), StageOf(tile.kind, tile.step, tile.before));
  return next == good.begin() ? kNoState : *std::prev(next) + 1;
}

}  // namespace tessera
