#include "server/leases/known_results.h"

#include <mutex>
#include <shared_mutex>
#include <utility>
#include <vector>

#include "absl/types/span.h"
#include "server/ledger/digest_proto.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

constexpr size_t kCheckedAtOnce = 256;  // tasks per check of the blob store

using Outputs = absl::InlinedVector<StoredFile, 1>;

struct KnownResult {
  TaskRef ref;
  Outputs outputs;
};

// Makes the task ready again, unless it has ended meanwhile. Needs the core's mutex.
void PutBack(DispatchCore& core, TaskRef ref) {
  const Job& job = core.ledger().jobs()[ref.job];
  if (job.deleted || job.failed >= 0 || job.tasks[ref.task].state != TaskState::kReady) return;
  const int ready_before = core.ledger().ready().count();
  core.ledger().ready().Add(ref, job.tasks[ref.task]);
  WakeWorkers(core, core.ledger().ready().count() - ready_before, core.ledger().newly_ready().size());
}

// The next tasks to check. Needs the core's mutex.
std::vector<KnownResult> TakeSetAside(DispatchCore& core) {
  std::vector<KnownResult> known;
  std::vector<TaskRef>& all = core.set_aside();
  for (; known.size() < kCheckedAtOnce && !all.empty(); all.pop_back()) {
    const TaskRef ref = all.back();
    if (MayReuse(core.ledger(), ref)) {
      known.push_back({ref, *core.ledger().results().Find(*core.ledger().task(ref).key)});
    } else {
      PutBack(core, ref);
    }
  }
  return known;
}

enum class Stored { kYes, kNo, kUnknown };

// The worst status of a result's blobs.
Stored StoredOf(absl::Span<const Status> blobs) {
  Stored stored = Stored::kYes;
  for (const Status& status : blobs) {
    if (absl::IsNotFound(status) || absl::IsInvalidArgument(status)) return Stored::kNo;
    if (!status.ok()) stored = Stored::kUnknown;
  }
  return stored;
}

// Completes the task, or makes it ready. A task whose own result was lost needs a proof that the other one is stored:
// else it would be lost again, and fail after max_remakes. Needs the core's mutex.
void Decide(DispatchCore& core, const KnownResult& known, Stored stored) {
  const bool same = MayReuse(core.ledger(), known.ref) &&
                    *core.ledger().results().Find(*core.ledger().task(known.ref).key) == known.outputs;
  if (!same) return PutBack(core, known.ref);
  const JobTask& task = core.ledger().task(known.ref);
  const Sha256 key = *task.key;
  const bool usable = stored == Stored::kYes || (stored == Stored::kUnknown && !task.remaking);
  v1::Record record;
  v1::TaskSucceeded& succeeded = *record.mutable_task_succeeded();
  succeeded.set_task(TaskName(known.ref));
  succeeded.set_key(key.Hex());
  succeeded.set_reused(true);
  AddFiles(known.outputs, succeeded.mutable_outputs());
  if (usable && core.Commit(record).ok()) return;
  core.ledger().results().Forget(key);
  PutBack(core, known.ref);
}

}  // namespace

bool MayReuse(Ledger& ledger, TaskRef ref) {
  if (ledger.jobs()[ref.job].deleted) return false;
  const JobTask& task = ledger.task(ref);
  if (task.state != TaskState::kReady || task.attempt() > 0) return false;
  const auto* outputs = ledger.results().Find(*task.key);
  return outputs != nullptr && (!task.remaking || *outputs == task.outputs);
}

void SetAside(DispatchCore& core, TaskRef ref) {
  core.ledger().ready().Remove(ref, core.ledger().task(ref));
  core.set_aside().push_back(ref);
}

bool ReuseResults(DispatchCore& core) {
  for (bool any = false;; any = true) {
    {
      std::lock_guard lock(core.mutex());
      if (core.set_aside().empty()) return any;
    }
    const std::shared_lock refers(core.blob_use().mutex);  // found blobs stay until Commit refers to them
    std::vector<KnownResult> known;
    {
      std::lock_guard lock(core.mutex());
      known = TakeSetAside(core);
    }
    std::vector<Digest> digests;
    for (const KnownResult& each : known) {
      for (const StoredFile& output : each.outputs) digests.push_back(output.digest());
    }
    const std::vector<Status> stored = StatMany(*core.environment().blobs, digests);
    size_t next = 0;
    for (const KnownResult& each : known) {
      const Stored of_result = StoredOf(absl::MakeConstSpan(stored).subspan(next, each.outputs.size()));
      next += each.outputs.size();
      std::lock_guard lock(core.mutex());
      Decide(core, each, of_result);
    }
  }
}

}  // namespace tessera
