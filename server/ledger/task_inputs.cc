#include "server/ledger/task_inputs.h"

#include <algorithm>

#include "common/job/task_parameters.h"
#include "server/ledger/ledger.h"

namespace tessera {

StatusOr<Digest> InputDigest(const Job& job, const PlannedInput& input) {
  const JobTask& producer = job.tasks[input.task.value()];
  for (const StoredFile& output : producer.outputs) {
    if (output.name == input.output) return output.digest();
  }
  return absl::NotFoundError("no output " + input.output.str() + " of '" + producer.plan.name + "' yet");
}

StatusOr<std::vector<NamedDigest>> InputsOf(const Job& job, const PlannedTask& task) {
  std::vector<NamedDigest> inputs;
  inputs.reserve(task.inputs.size() + task.scene_files->size() + task.view_files->size());
  for (const PlannedInput& input : task.inputs) {
    TESSERA_ASSIGN_OR_RETURN(const Digest digest, InputDigest(job, input));
    inputs.push_back({InputName(input), digest});
  }
  for (const int file : *task.scene_files) {
    const NamedDigest& found = job.scene_files[file];
    inputs.push_back({std::string(kSceneFolder) + "/" + found.name, found.digest});
  }
  for (const PlannedTask::ViewFile& file : *task.view_files) {
    inputs.push_back({ViewInputName(file), job.scene_files[file.file].digest});
  }
  return inputs;
}

// Breadth first over the bases, because an update may have two (its base and a rollback target) that share ancestors.
// A given task only passes a content on, so the search continues to the task that computed it.
StatusOr<TaskRef> MakerOf(const Ledger& ledger, int job, const Digest& digest, bool own) {
  const auto sha256 = Sha256::FromHex(digest.sha256);
  std::vector<int> search = {job};
  for (size_t at = 0; at < search.size(); ++at) {
    const Job& searched = ledger.jobs()[search[at]];
    if (searched.deleted) continue;
    for (int task = 0; (at > 0 || own) && task < static_cast<int>(searched.tasks.size()); ++task) {
      const JobTask& made = searched.tasks[task];
      if (!made.plan.given->empty() || (made.state != TaskState::kSucceeded && !made.remaking)) continue;
      const auto is_it = [&](const StoredFile& output) { return output.sha256 == sha256; };
      if (std::any_of(made.outputs.begin(), made.outputs.end(), is_it)) return TaskRef{search[at], task};
    }
    const UpdateSettings& update = searched.header.settings.update;
    for (const std::string& name : {update.base, update.rollback_to}) {
      const auto base = ledger.FindJob(name);
      if (base.ok() && std::find(search.begin(), search.end(), *base) == search.end()) search.push_back(*base);
    }
  }
  return absl::NotFoundError("no task of " + JobName(job) + " or of its base jobs made " + digest.sha256);
}

std::string TaskKey(const std::string& algorithm_version, const std::string& kind, const std::string& parameters,
                    std::vector<NamedDigest> inputs) {
  std::sort(inputs.begin(), inputs.end(), [](const NamedDigest& a, const NamedDigest& b) { return a.name < b.name; });
  Sha256Hasher hasher;
  // A length before each part makes the encoding unambiguous.
  const auto add = [&hasher](const std::string& part) { hasher.Update(std::to_string(part.size()) + ":" + part); };
  add("tessera-task");
  add(algorithm_version);
  add(kind);
  add(parameters);
  for (const NamedDigest& input : inputs) {
    add(input.name);
    add(input.digest.sha256);
  }
  return hasher.Finish();
}

}  // namespace tessera
