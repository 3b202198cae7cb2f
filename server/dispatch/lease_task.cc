// How a worker comes to a task.
#include <algorithm>
#include <chrono>
#include <limits>
#include <utility>

#include "server/dispatch/dispatcher.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

constexpr double kForever_s = std::numeric_limits<double>::infinity();

}  // namespace

StatusOr<GrantedLease> Dispatcher::DescribeLocked(TaskRef ref, int attempt) const {
  const Job& job = ledger_.jobs()[ref.job];
  GrantedLease granted;
  granted.task = TaskName(ref);
  granted.attempt = attempt;
  granted.plan = ledger_.task(ref).plan;
  granted.key = ledger_.task(ref).key;
  TESSERA_ASSIGN_OR_RETURN(std::vector<NamedDigest> inputs, ledger_.InputsOf(job, granted.plan));
  std::vector<int> files = granted.plan.scene_files;
  for (const PlannedTask::ViewFile& file : granted.plan.view_files) files.push_back(file.file);
  const size_t from_tasks = granted.plan.inputs.size();
  for (size_t i = 0; i < inputs.size(); ++i) {
    std::string path;
    if (i < from_tasks) {
      path = environment_.blobs->Path(inputs[i].digest);
    } else {
      const NamedDigest& file = job.scene_files[files[i - from_tasks]];
      path = job.header.scene_path + "/" + file.name;
      if (IsCarried(file.name)) {
        const std::vector<std::string> paths = ledger_.SceneFilesWith(file.digest);
        path = paths.empty() ? "" : paths.front();  // where it is not what it was, the blob service knows the others
      }
    }
    granted.inputs.push_back({std::move(inputs[i]), std::move(path)});
  }
  return granted;
}

StatusOr<GrantedLease> Dispatcher::GrantLocked(TaskRef ref, const std::string& worker) {
  TESSERA_ASSIGN_OR_RETURN(GrantedLease granted, DescribeLocked(ref, ledger_.task(ref).attempt() + 1));
  v1::Record record;
  record.mutable_attempt_started()->set_task(granted.task);
  record.mutable_attempt_started()->set_attempt(granted.attempt);
  record.mutable_attempt_started()->set_worker(worker);
  const WorkerState* const self = leases_.FindWorker(worker);
  if (self != nullptr) record.mutable_attempt_started()->set_machine(self->info.machine);
  TESSERA_RETURN_IF_ERROR(CommitLocked(record, Durability::kProcess));
  const int64_t now_us = environment_.clock->MonotonicUs();
  LeaseState& lease = leases_.Grant(ref, {worker, granted.attempt, now_us, now_us + Micros(options_.lease_s), now_us});
  leases_.NoteTile(worker, {ref.job, granted.plan.tile});
  if (self != nullptr) {
    granted.threads = ThreadsOfTask(leases_.LoadOf(worker), ledger_.ready().count(), self->info.threads);
    lease.threads = std::max(1, granted.threads);
  }
  return granted;
}

StatusOr<std::optional<GrantedLease>> Dispatcher::GrantedBeforeLocked(const std::string& worker, int64_t call) {
  const WorkerState* const self = leases_.FindWorker(worker);
  if (call <= 0 || self == nullptr || self->call != call) return std::nullopt;
  LeaseState* const lease = leases_.FindCurrent(self->granted, worker, self->granted_attempt);
  if (lease == nullptr) return std::nullopt;
  lease->expires_us = environment_.clock->MonotonicUs() + Micros(options_.lease_s);
  TESSERA_ASSIGN_OR_RETURN(GrantedLease granted, DescribeLocked(self->granted, self->granted_attempt));
  granted.threads = lease->threads;
  return granted;
}

StatusOr<std::optional<GrantedLease>> Dispatcher::LeaseTask(const std::string& worker, double wait_s,
                                                            const std::function<bool()>& gone, int64_t call) {
  const auto asked = std::chrono::steady_clock::now(), until = asked + std::chrono::microseconds(Micros(wait_s));
  std::unique_lock lock(mutex_);
  while (true) {
    TESSERA_RETURN_IF_ERROR(SeenLocked(worker));
    if (stopped_ || (gone && gone())) {
      waiting_.WakeNext();  // what it was woken for is another's
      return std::nullopt;
    }
    TESSERA_RETURN_IF_ERROR(ExpireLeasesLocked());
    // Also while this call waits: the one before, whose answer nobody takes, may be given a lease now.
    TESSERA_ASSIGN_OR_RETURN(const std::optional<GrantedLease> before, GrantedBeforeLocked(worker, call));
    if (before) {
      waiting_.WakeNext();  // what it was woken for is another's
      lock.unlock();
      TESSERA_RETURN_IF_ERROR(Durable());
      return before;
    }
    const auto now = std::chrono::steady_clock::now();
    const double waited_s = now < until ? std::chrono::duration<double>(now - asked).count() : kForever_s;
    // Nothing is leased that could not be stored: the worker would be thought dead if it never learns of it.
    const auto ref = journal_.trouble().ok() ? NextReadyLocked(worker, waited_s) : std::nullopt;
    if (ledger_.ready().count() > (ref ? 1 : 0)) waiting_.WakeNext();
    if (ref && MayReuseLocked(*ref)) {
      lock.unlock();
      TESSERA_RETURN_IF_ERROR(Reuse(*ref));
      TESSERA_RETURN_IF_ERROR(Advance());
      lock.lock();
      continue;
    }
    if (ref) {
      TESSERA_ASSIGN_OR_RETURN(GrantedLease granted, GrantLocked(*ref, worker));
      if (WorkerState* const self = leases_.FindWorker(worker)) {
        self->call = call;
        self->granted = *ref;
        self->granted_attempt = granted.attempt;
      }
      lock.unlock();
      const Status durable = Durable();
      if (durable.ok()) return granted;
      lock.lock();
      if (leases_.FindCurrent(*ref, worker, granted.attempt) != nullptr) {
        TESSERA_RETURN_IF_ERROR(FailAttemptLocked(*ref, {ErrorClass::kPreempted, "its lease could not be stored"}));
      }
      return durable;
    }
    if (now >= until) return std::nullopt;
    // In short slices: a back-off may end, a lease expire, the caller go.
    waiting_.Wait(lock, worker, std::min(until, now + std::chrono::milliseconds(500)));
  }
}

}  // namespace tessera
