// Results that an update takes from its base jobs.
#include <utility>

#include "common/job/task_parameters.h"
#include "server/ledger/ledger.h"

namespace tessera {

StatusOr<UpdateBase> Ledger::BaseOf(const std::string& name) const {
  TESSERA_ASSIGN_OR_RETURN(const int index, FindJob(name));
  const Job& job = jobs_[index];
  if (job.header.state != JobState::kSucceeded) {
    return absl::FailedPreconditionError(name + " has not succeeded: the base of an update must have succeeded");
  }
  TESSERA_RETURN_IF_ERROR(
      CheckVersion(index, "its results cannot be combined with new ones; submit its scene as a job without a base"));
  UpdateBase base;
  base.name = name;
  base.scene_files = job.scene_files;
  for (const JobTask& task : job.tasks) {
    if (task.superseded) continue;
    for (const StoredFile& output : task.outputs) {
      if (output.name == kBordersFile) base.borders = output.digest();
    }
    if (task.plan.kind != kPublishKind) continue;
    TESSERA_ASSIGN_OR_RETURN(const PublishParameters parameters, ParsePublishParameters(task.plan.parameters));
    base.tiles = parameters.tiles;
    base.flip_edges = parameters.flip_edges;
    const auto skip_gone = [&base] {
      std::vector<Digest>& states = base.states;
      while (states.size() < base.tiles.size() && base.tiles[states.size()].core.empty()) states.emplace_back();
    };
    for (const PlannedInput& input : task.plan.inputs) {
      TESSERA_ASSIGN_OR_RETURN(const Digest digest, InputDigest(job, input));
      const std::string as = InputName(input);
      if (as == kCityFile) {
        base.city = digest;
      } else if (as == kPlainSurveyFile) {
        base.plain = digest;
        TESSERA_ASSIGN_OR_RETURN(base.survey, InputDigest(job, {input.task, kSurveyFile}));
      } else if (as == kOutdatedFile) {
        base.outdated = digest;
      } else {  // states, in the order of the tiles
        skip_gone();
        base.states.push_back(digest);
      }
    }
    skip_gone();
  }
  if (base.tiles.empty()) {
    return absl::FailedPreconditionError(name + " has no result (it only planned): name its base job instead");
  }
  base.measured = MeasuredIn(job);
  return base;
}

StatusOr<UpdateBase> Ledger::BaseOf(const UpdateSettings& update) const {
  TESSERA_ASSIGN_OR_RETURN(UpdateBase base, BaseOf(update.base));
  if (update.rollback_to.empty()) return base;
  TESSERA_ASSIGN_OR_RETURN(const UpdateBase earlier, BaseOf(update.rollback_to));
  for (const int tile : update.rollback_tiles) base.states[tile] = earlier.states[tile];
  return base;
}

StatusOr<std::vector<UpdateBase>> Ledger::ChainTo(const std::string& name, const std::string& earlier) const {
  std::vector<UpdateBase> chain;
  std::string passed;
  for (std::string next = name; !next.empty();) {
    TESSERA_ASSIGN_OR_RETURN(chain.emplace_back(), BaseOf(next));
    if (next == earlier && chain.size() > 1) return chain;
    if (chain.size() > 1) passed += (passed.empty() ? "" : ", ") + next;
    next = jobs_[*FindJob(next)].header.settings.update.base;
  }
  return InputError(
      "rollback", "", earlier,
      passed.empty() ? name + " to have a base job: it has none" : "a base job of " + name + ": " + passed);
}

MeasuredCosts Ledger::MeasuredIn(const Job& last) const {
  MeasuredCosts measured;
  for (const Job* job = &last; job != nullptr;) {
    for (const JobTask& task : job->tasks) {
      const std::string& kind = task.plan.kind;
      if (task.state != TaskState::kSucceeded || task.reused) continue;
      if (kind == kUpdateKind || (kind == kIngestKind && job != &last)) continue;
      if (task.plan.scale == 0) continue;  // predicted by the model of an earlier release
      MeasuredCost& of_kind = measured[kind];
      of_kind.predicted += task.plan.cost / task.plan.scale;
      of_kind.used += task.usage.core_seconds;
    }
    const StatusOr<int> base = FindJob(job->header.settings.update.base);
    job = base.ok() ? &jobs_[*base] : nullptr;
  }
  return measured;
}

}  // namespace tessera
