#include "server/leases/dispatch_core.h"

#include <chrono>
#include <optional>
#include <utility>

#include "common/base/version.h"
#include "server/ledger/check_record.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

std::function<void(const std::string&)> ObserveWith(
    const std::function<void(const v1::Record&, const ChangedTask&)>& on_change, ChangedTasks& tasks) {
  if (!on_change) return {};
  return [on_change, &tasks](const std::string& bytes) {
    const ChangedTask task = tasks.Pop();
    v1::Record record;
    if (record.ParseFromString(bytes)) on_change(record, task);
  };
}

}  // namespace

DispatchCore::DispatchCore(const DispatchEnvironment& environment, const DispatchOptions& options)
    : environment_(environment),
      options_(options),
      ledger_(kAlgorithmVersion),
      journal_(environment.store,
               {options.durable_wait_s, ObserveWith(environment.on_change, changed_tasks_), environment.on_trouble,
                environment.on_taken_over}) {}

Status DispatchCore::Commit(v1::Record& record, Durability durability) {
  if (record.time_us() == 0) record.set_time_us(environment_.clock->UnixTimeUs());
  TESSERA_RETURN_IF_ERROR(CheckRecord(ledger_, record));
  const int ready_before = ledger_.ready().count();
  const size_t newly_ready_before = ledger_.newly_ready().size();
  ledger_.Apply(record);
  blob_use_.since.Note(record, ledger_);
  const std::optional<TaskRef> ref = TaskOf(record, ledger_);
  counts_.Count(record, ledger_, ref);
  if (environment_.on_change) {
    const JobTask* const task = ref ? &ledger_.task(*ref) : nullptr;
    changed_tasks_.Push(task ? ChangedTask{task->plan.kind, task->plan.tile, task->worker()} : ChangedTask());
  }
  const int64_t number = journal_.Add(record.SerializeAsString(), durability);
  if (record.has_job_ended()) end_records_[*ParseJobName(record.job_ended().job())] = number;
  Changed();
  WakeWorkers(*this, ledger_.ready().count() - ready_before, newly_ready_before);
  return absl::OkStatus();
}

bool DispatchCore::EndIsStored(int job) const {
  const auto end = end_records_.find(job);
  return end == end_records_.end() || end->second <= journal_.stored();
}

void DispatchCore::Changed() {
  ++version_;
  changed_.notify_all();
}

int64_t DispatchCore::WaitForChange(int64_t seen, double seconds) const {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, std::chrono::microseconds(Micros(seconds)), [&] { return stopped_ || version_ > seen; });
  return version_;
}

void DispatchCore::Drain() {
  std::lock_guard lock(mutex_);
  draining_ = true;
  waiting_.WakeAll();
  waiting_.Notify();
}

void DispatchCore::Stop() {
  std::lock_guard lock(mutex_);
  stopped_ = true;
  Changed();
  waiting_.WakeAll();
  waiting_.Notify();
}

void WakeWorkers(DispatchCore& core, int more, size_t first) {
  if (more <= 0) return;
  WaitingWorkers& waiting = core.waiting();
  const Ledger& ledger = core.ledger();
  waiting.ReadyHasGrown();
  for (size_t i = first; i < ledger.newly_ready().size(); ++i) {
    const TaskRef ref = ledger.newly_ready()[i];
    const std::string& last_worker = core.lease_table().LastWorkerOf({ref.job, ledger.task(ref).plan.tile});
    waiting.Wake(last_worker);
    more -= last_worker.empty() ? 0 : 1;  // that worker takes it or wakes another one
  }
  while (more-- > 0 && waiting.WakeNext()) {
  }
  waiting.Notify();
}

}  // namespace tessera
