#include "worker/tile/refine_tile.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "absl/strings/str_cat.h"
#include "common/base/elapsed.h"
#include "worker/tile/measure_tile.h"
#include "worker/tile/repair_tile.h"
#include "worker/tile/solve_tile.h"
#include "worker/tile/tile_fit.h"

namespace tessera {
namespace {

// Share of the progress: pixels of an iteration's level, beside one level 0 iteration.
double ProgressShare(const TileStep& at) { return at.labels() ? 1 : std::pow(0.25, at.step.level); }

std::string StepText(const TileStep& at) {
  if (at.labels()) return "labels";
  return absl::StrCat("round ", at.step.round + 1, ", level ", at.step.level, ", iteration ", at.level_iteration + 1);
}

}  // namespace

StatusOr<TileRefinement> RefineTile(TileWorkspace& work, TileImages& images, const std::vector<TileStep>& steps,
                                    const TileRefineOptions& options, const MappedState* start, bool to_end,
                                    const TaskControl& control, const Clock& clock) {
  if (!work.whole()) return absl::InvalidArgumentError("refine: the package is not that of a job's only tile");
  std::vector<StateSpans> states;
  if (start != nullptr) states.push_back(start->spans());
  TESSERA_ASSIGN_OR_RETURN(TileSnapshot snapshot, work.Assemble(states, kCoreRegion));
  TileRefinement out;
  const auto repair = [&](RepairStage stage) -> Status {
    const int64_t start_us = clock.MonotonicUs();
    TESSERA_ASSIGN_OR_RETURN(const CoreRepair repaired, Repair(work, stage, options, &snapshot));
    out.left_faces += repaired.left_faces;
    out.seconds_repair += SecondsSince(clock, start_us);
    return absl::OkStatus();
  };
  double done = 0, total = 0;
  for (const TileStep& at : steps) total += ProgressShare(at);
  bool unfolded = start != nullptr;
  StepSums sums;
  for (const TileStep& at : steps) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(done / total, StepText(at));
    const TaskControl part = PartOf(control, done / total, (done + ProgressShare(at)) / total);
    done += ProgressShare(at);
    if (at.labels()) {
      work.EndIterations();
      images.data_term.ReleaseBuffers();
      sums = StepSums();
    } else if (!unfolded) {
      TESSERA_RETURN_IF_ERROR(repair(RepairStage::kStart));
      unfolded = true;
    }
    const int64_t start_us = clock.MonotonicUs();
    TESSERA_RETURN_IF_ERROR(Measure(work, images, snapshot, at, options, part, clock, &sums));
    const double measured_s = SecondsSince(clock, start_us);
    Solve(work, at, sums, options, &snapshot);
    if (at.labels()) {
      out.seconds_labels += SecondsSince(clock, start_us);
      sums = StepSums();
      continue;
    }
    const PhotoSums& photo = sums.derivatives.photo;
    out.seconds_loading += sums.seconds_loading;
    out.seconds_visibility += photo.seconds_visibility;
    out.seconds_data += measured_s - sums.seconds_loading - photo.seconds_visibility;
    out.seconds_step += SecondsSince(clock, start_us) - measured_s;
    if (at.step.ends_level) TESSERA_RETURN_IF_ERROR(repair(RepairStage::kLevel));
  }
  if (to_end && work.package().has_pairs && std::any_of(steps.begin(), steps.end(), [](auto& at) { return !at.labels(); })) {
    work.EndIterations();
    images.data_term.ReleaseBuffers();
    TESSERA_ASSIGN_OR_RETURN(const TileFit fit, CompareFit(work, images, snapshot.positions, PartOf(control, 1, 1)));
    nlohmann::json report = nlohmann::json::parse(snapshot.report);
    report["fit"] = nlohmann::json::parse(ToJson(fit));
    snapshot.report = report.dump();
  }
  FillConfidence(work.package(), &snapshot);
  out.state = work.StateOf(snapshot);
  return out;
}

}  // namespace tessera
