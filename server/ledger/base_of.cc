#include "server/ledger/base_of.h"

#include <utility>

#include "common/job/task_parameters.h"
#include "server/ledger/ledger.h"
#include "server/ledger/task_inputs.h"

namespace tessera {
namespace {

// Predicted and used cost of the tasks that ran in this job and its base jobs: UpdateBase::measured.
MeasuredCosts MeasuredIn(const Ledger& ledger, const Job& last) {
  MeasuredCosts measured;
  for (const Job* job = &last; job != nullptr;) {
    for (const JobTask& task : job->tasks) {
      std::string kind = task.plan.kind;
      if (kind == kInspectKind) kind = job->header.settings.update.base.empty() ? kIngestKind : kUpdateKind;
      if (task.state != TaskState::kSucceeded || task.reused) continue;
      if (kind == kUpdateKind || (kind == kIngestKind && job != &last)) continue;
      if (task.plan.scale == 0) continue;  // predicted by the model of an earlier release
      MeasuredCost& of_kind = measured[kind];
      of_kind.predicted += task.plan.cost / task.plan.scale;
      of_kind.used += task.usage.core_seconds;
    }
    const StatusOr<int> base = ledger.FindJob(job->header.settings.update.base);
    job = base.ok() ? &ledger.jobs()[*base] : nullptr;
  }
  return measured;
}

Status CheckMayUpdate(const Ledger& ledger, int index) {
  const JobHeader& header = ledger.jobs()[index].header;
  if (header.state != JobState::kSucceeded) {
    return absl::FailedPreconditionError(header.name + " has not succeeded: the base of an update must have succeeded");
  }
  return ledger.CheckVersion(index,
                             "its results cannot be combined with new ones; submit its scene as a job without a base");
}

Status CheckMayExport(const Ledger& ledger, int index) {
  const JobHeader& header = ledger.jobs()[index].header;
  if (header.state != JobState::kSucceeded && header.state != JobState::kPartial) {
    return absl::FailedPreconditionError(header.name + " has no result, or not yet: nothing to export");
  }
  return ledger.CheckVersion(index, "fetch its result and export the folder (tessera export DIR)");
}

// Of a job that passed one of these checks.
StatusOr<UpdateBase> ResultOf(const Ledger& ledger, int index) {
  const Job& job = ledger.jobs()[index];
  const std::string& name = job.header.name;
  const UpdateSettings& update = job.header.settings.update;
  if (update.export_only) {
    return absl::FailedPreconditionError(name + " only exports the result of " + update.base + ": name " + update.base +
                                         " instead");
  }
  UpdateBase base;
  base.name = name;
  base.scene_files = job.scene_files;
  for (const JobTask& task : job.tasks) {
    if (task.superseded) continue;
    for (const StoredFile& output : task.outputs) {
      if (output.name == kBordersFile) base.borders = output.digest();
      if (output.name == kChangesGeoJsonFile) base.changes = output.digest();
    }
    if (task.plan.kind != kPublishKind) continue;
    TESSERA_ASSIGN_OR_RETURN(const PublishParameters parameters, ParsePublishParameters(task.plan.parameters));
    base.tiles = parameters.tiles;
    base.quarantined = parameters.quarantined;
    for (const StoredFile& output : task.outputs) {
      if (output.name == kMeshFile) base.mesh = output.digest();
    }
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
  base.measured = MeasuredIn(ledger, job);
  return base;
}

}  // namespace

StatusOr<UpdateBase> BaseOf(const Ledger& ledger, const std::string& name) {
  TESSERA_ASSIGN_OR_RETURN(const int index, ledger.FindJob(name));
  TESSERA_RETURN_IF_ERROR(CheckMayUpdate(ledger, index));
  return ResultOf(ledger, index);
}

StatusOr<UpdateBase> BaseOf(const Ledger& ledger, const UpdateSettings& update) {
  if (update.export_only) {
    TESSERA_ASSIGN_OR_RETURN(const int index, ledger.FindJob(update.base));
    TESSERA_RETURN_IF_ERROR(CheckMayExport(ledger, index));
    return ResultOf(ledger, index);
  }
  TESSERA_ASSIGN_OR_RETURN(UpdateBase base, BaseOf(ledger, update.base));
  if (update.rollback_to.empty()) return base;
  TESSERA_ASSIGN_OR_RETURN(const UpdateBase earlier, BaseOf(ledger, update.rollback_to));
  for (const int tile : update.rollback_tiles) base.states[tile] = earlier.states[tile];
  return base;
}

StatusOr<std::vector<UpdateBase>> ChainTo(const Ledger& ledger, const std::string& name, const std::string& earlier) {
  std::vector<UpdateBase> chain;
  std::string passed;
  for (std::string next = name; !next.empty();) {
    TESSERA_ASSIGN_OR_RETURN(chain.emplace_back(), BaseOf(ledger, next));
    if (next == earlier && chain.size() > 1) return chain;
    if (chain.size() > 1) passed += (passed.empty() ? "" : ", ") + next;
    next = ledger.jobs()[*ledger.FindJob(next)].header.settings.update.base;
  }
  return InputError(
      "rollback", "", earlier,
      passed.empty() ? name + " to have a base job, but it has none" : "a base job of " + name + ": " + passed);
}

}  // namespace tessera
