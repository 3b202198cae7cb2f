#include "server/leases/known_results.h"

#include <algorithm>
#include <mutex>
#include <shared_mutex>

#include "server/ledger/digest_proto.h"
#include "tessera/v1/records.pb.h"

namespace tessera {

bool MayReuse(Ledger& ledger, TaskRef ref) {
  if (ledger.jobs()[ref.job].deleted) return false;
  const JobTask& task = ledger.task(ref);
  if (task.state != TaskState::kReady || task.attempt() > 0) return false;
  const auto* outputs = ledger.results().Find(*task.key);
  return outputs != nullptr && (!task.remaking || *outputs == task.outputs);
}

Status Reuse(DispatchCore& core, TaskRef ref) {
  const std::shared_lock refers(core.blob_use().mutex);
  Sha256 key;
  absl::InlinedVector<StoredFile, 1> outputs;
  {
    std::lock_guard lock(core.mutex());
    if (!MayReuse(core.ledger(), ref)) return absl::OkStatus();
    key = *core.ledger().task(ref).key;
    outputs = *core.ledger().results().Find(key);
  }
  const bool stored = std::all_of(outputs.begin(), outputs.end(), [&](const StoredFile& output) {
    return core.environment().blobs->Has(output.digest());
  });
  std::lock_guard lock(core.mutex());
  if (!MayReuse(core.ledger(), ref)) return absl::OkStatus();
  if (!stored) {
    core.ledger().results().Forget(key);
    return absl::OkStatus();
  }
  v1::Record record;
  v1::TaskSucceeded& succeeded = *record.mutable_task_succeeded();
  succeeded.set_task(TaskName(ref));
  succeeded.set_key(key.Hex());
  succeeded.set_reused(true);
  AddFiles(outputs, succeeded.mutable_outputs());
  return core.Commit(record);
}

}  // namespace tessera
