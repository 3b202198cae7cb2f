// Grants leases to calling and waiting workers.
#include <algorithm>
#include <chrono>
#include <limits>
#include <memory>
#include <utility>

#include "common/base/refusal.h"
#include "common/s3/s3_location.h"
#include "server/leases/attempts.h"
#include "server/leases/known_results.h"
#include "server/leases/leases.h"
#include "server/leases/placement.h"
#include "server/ledger/task_inputs.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {
constexpr double kForever_s = std::numeric_limits<double>::infinity();

constexpr std::chrono::milliseconds kRetryInterval{500};  // interval of retries for a waiting call
constexpr size_t kServedAtOnce = 16;                      // calls served per hold of the mutex
constexpr int kSetAsideAtOnce = 64;                       // tasks with known results per try

// The lease of the task, without its number of threads. Needs the core's mutex.
StatusOr<GrantedLease> Describe(DispatchCore& core, TaskRef ref, int attempt) {
  const Ledger& ledger = core.ledger();
  const Job& job = ledger.jobs()[ref.job];
  GrantedLease granted;
  granted.task = TaskName(ref);
  granted.attempt = attempt;
  granted.plan = ledger.task(ref).plan;
  granted.key = ledger.task(ref).key_hex();
  TESSERA_ASSIGN_OR_RETURN(std::vector<NamedDigest> inputs, InputsOf(job, granted.plan));
  std::vector<int> files = *granted.plan.scene_files;
  for (const PlannedTask::ViewFile& file : *granted.plan.view_files) files.push_back(file.file);
  const size_t from_tasks = granted.plan.inputs.size();
  for (size_t i = 0; i < inputs.size(); ++i) {
    std::string path;
    if (i < from_tasks || job.scene_files[files[i - from_tasks]].name == kClassifierFile) {
      path = core.environment().blobs->LocalPath(inputs[i].digest).value_or("");
    } else {
      const NamedDigest& file = job.scene_files[files[i - from_tasks]];
      path = job.header.scene_path + "/" + file.name;
      if (IsCarried(file.name)) {
        const std::vector<std::string> paths = ledger.scene_files().PathsOf(file.digest);
        path = paths.empty() ? "" : paths.front();  // the blob service tries the others if it changed
      }
      if (IsS3Url(path)) path.clear();  // GetTransfers gives a URL
    }
    granted.inputs.push_back({std::move(inputs[i]), std::move(path)});
  }
  return granted;
}

}  // namespace

StatusOr<GrantedLease> Leases::GrantLocked(TaskRef ref, const std::string& worker) {
  TESSERA_ASSIGN_OR_RETURN(GrantedLease granted, Describe(core_, ref, ledger_.task(ref).attempt() + 1));
  v1::Record record;
  record.mutable_attempt_started()->set_task(granted.task);
  record.mutable_attempt_started()->set_attempt(granted.attempt);
  record.mutable_attempt_started()->set_worker(worker);
  const WorkerState* const self = leases_.FindWorker(worker);
  if (self != nullptr) record.mutable_attempt_started()->set_machine(self->info.machine);
  TESSERA_RETURN_IF_ERROR(core_.Commit(record, Durability::kProcess));
  const int64_t now_us = environment_.clock->MonotonicUs();
  LeaseState& lease = leases_.Grant(ref, {worker, granted.attempt, now_us, kNotSent_us, kNotSent_us});
  leases_.NoteTile(worker, {ref.job, granted.plan.tile});
  if (self != nullptr) {
    granted.threads = ThreadsOfTask(leases_.LoadOf(worker), ledger_.ready().count(), self->info.threads);
    lease.threads = std::max(1, granted.threads);
  }
  return granted;
}

StatusOr<std::optional<GrantedLease>> Leases::GrantedBeforeLocked(const std::string& worker, int64_t call) {
  const WorkerState* const self = leases_.FindWorker(worker);
  if (call <= 0 || self == nullptr || self->call != call) return std::nullopt;
  LeaseState* const lease = leases_.FindCurrent(self->granted, worker, self->granted_attempt);
  if (lease == nullptr) return std::nullopt;
  TESSERA_ASSIGN_OR_RETURN(GrantedLease granted, Describe(core_, self->granted, self->granted_attempt));
  granted.threads = lease->threads;
  lease->expires_us = kNotSent_us;
  return granted;
}

// The outcome of one try to serve a call.
struct Leases::Try {
  bool waits = false;      // no task for it now
  bool at_once = false;    // it waits only until the mutex was free for others
  bool set_aside = false;  // tasks with known results were set aside, so the planning loop must check them
  LeaseAnswer answer = std::nullopt;
  TaskRef granted = {};  // the leased task; task -1: none
  bool is_new = false;   // the call started the attempt; false: it repeats an earlier lease
};

// Each return that leaves a ready task to others wakes the next waiting call: one ready task wakes one call, and a call
// that does not take it would otherwise leave it unleased.
Leases::Try Leases::TryLocked(const LeaseCall& call) {
  Try tried;
  if (Status seen = MarkSeen(core_, call.worker); !seen.ok()) {
    tried.answer = std::move(seen);
    return tried;
  }
  if (core_.stopped() || (call.gone && call.gone())) {
    waiting_.WakeNext();  // passes the task on
    return tried;
  }
  if (Status expired = ExpireLocked(); !expired.ok()) {
    tried.answer = std::move(expired);
    return tried;
  }
  // Needed for waiting calls too: an abandoned earlier call with this number may have got the lease.
  tried.answer = GrantedBeforeLocked(call.worker, call.call);
  if (!tried.answer.ok() || *tried.answer) {
    if (tried.answer.ok()) tried.granted = leases_.FindWorker(call.worker)->granted;
    waiting_.WakeNext();
    return tried;
  }
  if (core_.draining()) {
    tried.answer = DrainingError("grants no leases");
    return tried;
  }
  // Its memory, cores and time are not known. After a report it calls again for its next task.
  if (const WorkerState* const self = leases_.FindWorker(call.worker); self->is_restored) {
    if (!call.comes_with_report) {
      if (self->tasks.empty()) leases_.RemoveWorker(call.worker);
      tried.answer = UnknownWorker(call.worker);
    }
    waiting_.WakeNext();
    return tried;
  }
  const auto now = std::chrono::steady_clock::now();
  const double waited_s = call.comes_with_report ? 0.0
                          : now < call.until     ? std::chrono::duration<double>(now - call.asked).count()
                                                 : kForever_s;
  Placement placement;
  // No leases while the journal fails: the worker would not get the lease and would count as silent.
  if (journal_.trouble().ok()) {
    const auto place = [&] {
      placement = PlaceTask(ledger_, leases_, call.worker, waited_s, environment_.clock->MonotonicUs());
      return placement.task && MayReuse(ledger_, *placement.task);
    };
    for (int aside = 0; place(); ++aside) {
      tried.at_once = aside == kSetAsideAtOnce;
      if (tried.at_once) break;
      SetAside(core_, *placement.task);
      tried.set_aside = true;
    }
  }
  const std::optional<TaskRef> ref = tried.at_once ? std::nullopt : placement.task;
  if (!placement.left_to_others && ledger_.ready().count() > (ref ? 1 : 0)) waiting_.WakeNext();
  if (!ref) {
    tried.waits = tried.at_once || now < call.until;
    return tried;
  }
  auto granted = GrantLocked(*ref, call.worker);
  if (WorkerState* const self = leases_.FindWorker(call.worker); granted.ok() && self != nullptr) {
    self->call = call.call;
    self->granted = *ref;
    self->granted_attempt = granted->attempt;
    tried.granted = *ref;
    tried.is_new = true;
  }
  tried.answer = std::move(granted);
  return tried;
}

void Leases::Answer(LeaseCall call, Try tried) {
  if (!tried.answer.ok() || !*tried.answer) return call.done(std::move(tried.answer));
  auto ended = std::make_shared<std::pair<LeaseCall, Try>>(std::move(call), std::move(tried));
  journal_.WhenStored([this, ended](const Status& durable) {
    auto& [of_worker, given] = *ended;
    const int attempt = (*given.answer)->attempt;
    if (!durable.ok()) given.answer = durable;
    {
      std::lock_guard lock(mutex_);
      LeaseState* const lease = leases_.FindCurrent(given.granted, of_worker.worker, attempt);
      if (lease != nullptr && !durable.ok() && given.is_new) {
        const Status failed =
            FailAttempt(core_, given.granted, {ErrorClass::kPreempted, "the journal could not store its lease"});
        if (!failed.ok()) given.answer = failed;
      } else if (lease != nullptr) {  // the worker gets the lease now, so it can expire
        const int64_t now_us = environment_.clock->MonotonicUs();
        lease->expires_us = now_us + Micros(options_.lease_s);
        if (given.is_new) lease->progressed_us = now_us;
      }
    }
    of_worker.done(std::move(given.answer));
  });
}

void Leases::LeaseTask(LeaseCall call) {
  call.asked = std::chrono::steady_clock::now();
  call.until = call.asked + std::chrono::microseconds(Micros(call.wait_s));
  std::optional<LeaseCall> earlier;
  Try tried;
  {
    std::lock_guard lock(mutex_);
    earlier = waiting_.Take(call.worker);
    tried = TryLocked(call);
    if (tried.waits) {
      waiting_.Add(call, tried.at_once ? call.asked : std::min(call.until, call.asked + kRetryInterval));
    }
    waiting_.Notify();
  }
  if (tried.set_aside) events_.advance_soon();
  if (earlier) earlier->done(absl::AbortedError("replaced by a later call of " + call.worker + " for a task"));
  if (!tried.waits) Answer(std::move(call), std::move(tried));
}

void Leases::CheckWaitingCall(const std::string& worker) {
  std::lock_guard lock(mutex_);
  if (waiting_.Wake(worker)) waiting_.Notify();
}

void Leases::ServeWaiting() {
  std::unique_lock lock(mutex_);
  while (const std::optional<LeaseCall::Time> due = waiting_.AwaitDue(lock)) {
    const LeaseCall::Time now = *due;
    std::vector<std::pair<LeaseCall, Try>> ends;
    bool set_aside = false, at_once = false;
    while (!at_once && ends.size() < kServedAtOnce) {
      std::optional<LeaseCall> call = waiting_.TakeDue(now);
      if (!call) break;
      Try tried = TryLocked(*call);
      set_aside = set_aside || tried.set_aside;
      at_once = tried.at_once;
      if (tried.waits) {
        // Short intervals, because a retry delay may end or a lease expire.
        waiting_.Add(*std::move(call), at_once ? now : std::min(call->until, now + kRetryInterval));
      } else {
        ends.emplace_back(*std::move(call), std::move(tried));
      }
    }
    lock.unlock();
    for (auto& [call, tried] : ends) Answer(std::move(call), std::move(tried));
    if (set_aside) events_.advance_soon();
    lock.lock();
  }
}

}  // namespace tessera
