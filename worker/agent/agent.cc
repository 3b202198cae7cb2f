#include "worker/agent/agent.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <limits>
#include <mutex>
#include <new>
#include <optional>
#include <thread>

#include "common/base/parallel.h"
#include "common/base/refusal.h"
#include "common/job/end_margin.h"
#include "common/job/task_parameters.h"
#include "common/log/log.h"
#include "common/rpc/blob_client.h"
#include "common/rpc/channel.h"
#include "common/storage/files.h"
#include "worker/agent/attempt.h"
#include "worker/agent/on_demand.h"
#include "worker/agent/task_files.h"

namespace tessera {
namespace {

constexpr int kMaxReregistrations = 3;  // times that one call registers again

// Runs the task and turns exceptions into a status, so that a task cannot terminate the worker.
StatusOr<TaskOutcome> RunGuarded(const TaskRunner& runner, const TaskRequest& request, const TaskControl& control) {
  try {
    return runner(request, control);
  } catch (const std::bad_alloc&) {
    return AsStatus(FailureClass::kMemory, request.kind + " task: out of memory");
  } catch (const std::exception& error) {
    return AsStatus(FailureClass::kInternal, request.kind + " task: unexpected exception: " + error.what());
  } catch (...) {
    return AsStatus(FailureClass::kInternal, request.kind + " task: unexpected exception of unknown type");
  }
}

// Tests whether a file can be written in the folder.
Status TryToWrite(const std::string& folder) {
  const std::string path = folder + "/probe";
  const Status written = WriteFileAtomic(path, std::string(size_t{1} << 20, 'x'));
  TESSERA_RETURN_IF_ERROR(RemoveTree(path));
  return written;
}

// Classifies the error of a task from what can be observed: a task only reads its inputs and writes to its folder.
Status ClassifyFailure(const Status& status, TaskFiles& files, const TaskRequest& request) {
  if (IsFailure(status) || absl::IsCancelled(status)) return status;
  const std::string message = MessageOf(status);
  switch (status.code()) {
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kNotFound:
    case absl::StatusCode::kDataLoss:
    case absl::StatusCode::kOutOfRange:
      if (IsFileError(status)) break;
      // The inputs may have been damaged since they were fetched.
      TESSERA_RETURN_IF_ERROR(files.CheckInputs(/*read=*/true));
      return AsStatus(FailureClass::kInput, message);
    default:
      break;
  }
  TESSERA_RETURN_IF_ERROR(files.CheckInputs(/*read=*/false));
  if (IsFileError(status)) return AsStatus(FailureClass::kScratch, message);
  if (absl::IsResourceExhausted(status)) return AsStatus(FailureClass::kMemory, message);
  if (const Status room = TryToWrite(request.output_dir); !room.ok()) {  // libraries do not report full disks
    return AsStatus(FailureClass::kScratch, message + "; " + MessageOf(room));
  }
  return AsStatus(FailureClass::kInternal, message);
}

// Whether the report was accepted or rejected for good. All other errors are transient.
bool IsAnswered(const Status& report) {
  return report.ok() || absl::IsFailedPrecondition(report) || absl::IsInvalidArgument(report) ||
         absl::IsNotFound(report);
}

double SecondsSince(std::chrono::steady_clock::time_point time) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - time).count();
}

LogFields With(LogFields fields, const std::string& key, const std::string& value) {
  fields.emplace_back(key, value);
  return fields;
}

RetryPolicy WithoutLimit(RetryPolicy policy) {
  policy.max_attempts = 0;
  return policy;
}

}  // namespace

class Agent::Impl {
 public:
  Impl(const AgentOptions& options, TaskRunner runner, FileLock lock, std::unique_ptr<BlobCache> cache,
       std::shared_ptr<CallIdentity> identity, std::shared_ptr<grpc::Channel> channel)
      : options_(options),
        runner_(std::move(runner)),
        lock_(std::move(lock)),
        identity_(std::move(identity)),
        channel_(std::move(channel)),
        link_(channel_),
        files_(BlobClient(
                   channel_, WithoutLimit(options.retry), [this](double seconds) { return Wait(seconds); },
                   options.coordinator.store_ca),
               std::move(cache), options.use_shared_storage,
               {options.storage_wait_s, options.retry, [this](double seconds) { return Wait(seconds); }}) {}

  Status Run() {
    Status status = Register("");
    if (status.ok()) {
      std::thread heartbeats([this] { SendHeartbeats(); });
      status = LeaseLoop();
      {
        std::lock_guard lock(mutex_);
        ended_ = true;
      }
      changed_.notify_all();
      heartbeats.join();
      const Status unregistered = link_.Unregister(worker());
      LogInfo("stopped", {{"worker", worker()}, {"unregistered", unregistered.ok() ? "yes" : MessageOf(unregistered)}});
    } else if (LeasingLeft_s() <= 0) {
      status = absl::UnavailableError(
          "no coordinator at " + options_.coordinator.address + " accepted this worker for " +
          std::to_string(static_cast<int64_t>(SecondsSince(created_))) + " s: " + MessageOf(status));
    }
    return draining_ ? absl::OkStatus() : status;
  }

  void StopLeasing() {
    {
      std::lock_guard lock(mutex_);
      last_task_ = true;
      if (attempt_ == nullptr) draining_ = true;
    }
    changed_.notify_all();
    link_.StopLeasing();
  }

  void Drain() {
    {
      std::lock_guard lock(mutex_);
      draining_ = true;
    }
    changed_.notify_all();
    link_.StopLeasing();
  }

 private:
  std::string worker() const {
    std::lock_guard lock(mutex_);
    return registration_.worker;
  }

  // Returns false early if the worker drains or the current attempt has lost its lease.
  bool Wait(double seconds) {
    std::unique_lock lock(mutex_);
    return !changed_.wait_for(lock, std::chrono::duration<double>(seconds),
                              [&] { return draining_ || (attempt_ != nullptr && attempt_->LeaseLost()); });
  }

  // Registers, unless another thread has registered since the worker was `forgotten`. Retries without limit;
  // CANCELLED when draining.
  Status Register(const std::string& forgotten) {
    std::lock_guard one_at_a_time(registering_);
    if (worker() != forgotten) return absl::OkStatus();
    bool warned = false;
    Registration registration;
    const auto call = [&] {
      WorkerDescription description = options_.description;
      if (description.time_left_s > 0) {
        description.time_left_s = std::max(1.0, description.time_left_s - SecondsSince(created_));
      }
      auto answer = link_.Register(description);
      if (answer.ok()) {
        registration = *std::move(answer);
      } else if (!warned) {
        warned = true;
        LogWarning("cannot register; retrying",
                   {{"coordinator", options_.coordinator.address}, {"reason", MessageOf(answer.status())}});
      }
      return answer.status();
    };
    const Status status = Retry(
        WithoutLimit(options_.retry), Idempotency::kIdempotent,
        [this](double seconds) { return WaitToRegister(seconds); }, call);
    TESSERA_RETURN_IF_ERROR(status);
    identity_->SetWorker(registration.worker, registration.secret);
    std::lock_guard lock(mutex_);
    registration_ = registration;
    to_probe_ = true;
    LogInfo("registered", {{"worker", registration.worker}, {"coordinator", options_.coordinator.address}});
    return absl::OkStatus();
  }

  // False if the worker ends instead.
  bool WaitToRegister(double seconds) {
    const double left_s = LeasingLeft_s();
    if (left_s <= 0) return false;
    std::unique_lock lock(mutex_);
    return !changed_.wait_for(lock, std::chrono::duration<double>(std::min(seconds, left_s)),
                              [&] { return draining_ || ended_; });
  }

  // Until the worker ends because it has no task, or because its allocation ends.
  double LeasingLeft_s() const {
    std::lock_guard lock(mutex_);
    double left_s = std::numeric_limits<double>::infinity();
    if (attempt_ != nullptr) return left_s;
    if (options_.idle_s > 0) left_s = options_.idle_s - SecondsSince(idle_since_);
    if (const double limit_s = options_.description.time_left_s; limit_s > 0) {
      left_s = std::min(left_s, limit_s - kEndMargin_s - SecondsSince(created_));
    }
    return left_s;
  }

  // Runs `call` with the worker's name. If the coordinator does not have the worker, registers and retries.
  Status CallAs(const std::function<Status(const std::string& worker)>& call) {
    for (int forgotten = 0;; ++forgotten) {
      const std::string name = worker();
      const Status status = call(name);
      if (RefusalOf(status) != Refusal::kUnknownWorker || forgotten >= kMaxReregistrations) return status;
      TESSERA_RETURN_IF_ERROR(Register(name));
    }
  }

  Status LeaseLoop() {
    Backoff backoff(options_.retry);
    bool unreachable = false;
    std::optional<LeasedTask> lease;
    while (!draining_ && !last_task_) {
      if (lease) {
        lease = RunLease(*lease);
        continue;
      }
      const double left_s = LeasingLeft_s();
      if (left_s <= 0) {
        LogInfo("no task, or the time limit is near: stops", {{"worker", worker()}});
        break;
      }
      const Status status = CallAs([&](const std::string& name) -> Status {
        auto answer = link_.Lease(name, std::min(options_.lease_wait_s, left_s), lease_call_);
        if (answer.ok()) lease = *std::move(answer);
        return answer.status();
      });
      if (draining_) break;
      if (status.ok()) {
        ++lease_call_;
        if (unreachable) LogInfo("coordinator reachable again", {{"coordinator", options_.coordinator.address}});
        unreachable = false;
        backoff.Reset();
        continue;
      }
      if (RefusalOf(status) == Refusal::kOtherVersion) return status;
      if (!unreachable) LogWarning("cannot get a task; retrying", {{"reason", MessageOf(status)}});
      unreachable = true;
      Wait(std::min(backoff.NextDelay(status), left_s));
    }
    return absl::OkStatus();
  }

  // Returns the next lease if the report's answer contained one.
  std::optional<LeasedTask> RunLease(const LeasedTask& lease) {
    const auto attempt = std::make_shared<Attempt>(lease.task, lease.attempt);
    SetAttempt(attempt);
    const LogFields who = FieldsOf(lease);
    LogInfo("started", With(who, "title", lease.title));
    const AttemptReport report = Work(lease, *attempt);
    std::optional<LeasedTask> next;
    if (attempt->LeaseLost()) {
      LogInfo("lease lost: result discarded", who);
    } else {
      next = Deliver(report, *attempt, who);
    }
    SetAttempt(nullptr);
    return next;
  }

  LogFields FieldsOf(const LeasedTask& lease) const {
    LogFields fields = {{"job", lease.task.substr(0, lease.task.find("/tasks/"))}};
    if (lease.tile >= 0) fields.emplace_back("tile", std::to_string(lease.tile));
    fields.emplace_back("task", lease.task);
    fields.emplace_back("attempt", std::to_string(lease.attempt));
    fields.emplace_back("worker", worker());
    fields.emplace_back("kind", lease.kind);
    return fields;
  }

  void SetAttempt(std::shared_ptr<Attempt> attempt) {
    std::lock_guard lock(mutex_);
    attempt_ = std::move(attempt);
    idle_since_ = std::chrono::steady_clock::now();
  }

  // Runs one lease from fetching inputs to storing outputs.
  AttemptReport Work(const LeasedTask& lease, Attempt& attempt) {
    AttemptReport report;
    report.task = lease.task;
    report.attempt = lease.attempt;
    TaskControl control;
    control.report = [&attempt](double fraction, const std::string& stage) { attempt.SetProgress(fraction, stage); };
    control.cancelled = [this, &attempt] { return draining_ || attempt.LeaseLost(); };
    const Status status = WorkIn(lease, control, report);
    files_.Release();
    if (!status.ok()) folder_.reset();  // remove partial files
    report.succeeded = status.ok();
    if (!status.ok()) {
      report.failure = FailureOf(status);
      if (absl::IsCancelled(status) && draining_) report.failure.failure_class = FailureClass::kPreempted;
    }
    return report;
  }

  Status WorkIn(const LeasedTask& lease, const TaskControl& control, AttemptReport& report) {
    ProbeIfNew();
    const TaskUsageMeter meter(peaks_.IsDue(lease.kind));  // a worker runs one task at a time
    std::optional<ThreadLimit> thread_limit;
    if (lease.threads > 0) thread_limit.emplace(lease.threads);
    TaskRequest request;
    request.kind = lease.kind;
    request.parameters = lease.parameters;
    if (const Status made = MakeFolders(request); !made.ok()) return AsStatus(FailureClass::kScratch, MessageOf(made));
    OnDemand later(lease.inputs, request.input_dir);
    TESSERA_RETURN_IF_ERROR(files_.BringInputs(later.TakeOthers(), request.input_dir, control));
    request.fetch = [&](const std::vector<std::string>& paths) {
      TaskControl silent;  // the task reports its progress
      silent.cancelled = control.cancelled;
      return files_.BringInputs(later.Take(paths), request.input_dir, silent);
    };
    const StatusOr<TaskOutcome> outcome = RunGuarded(runner_, request, control);
    if (!outcome.ok()) return ClassifyFailure(outcome.status(), files_, request);
    TESSERA_RETURN_IF_ERROR(control.Check());
    TESSERA_RETURN_IF_ERROR(files_.CheckInputs(/*read=*/outcome->found_faults));
    TESSERA_ASSIGN_OR_RETURN(report.outputs, files_.StoreOutputs(outcome->outputs, request.output_dir, control));
    report.stats = outcome->stats;
    report.warnings = outcome->warnings;
    report.usage = meter.Read();
    return absl::OkStatus();
  }

  // Folders for a task's files. Reused by the next task if empty and without a scene, since creating them dominates the
  // cost of short tasks.
  Status MakeFolders(TaskRequest& request) {
    std::error_code error;
    if (folder_ && (!std::filesystem::is_empty(folder_->path() + "/out", error) || error)) folder_.reset();
    // An empty folder of likelihoods or masks would be part of the next task's scene.
    if (folder_ && std::filesystem::exists(folder_->path() + "/in/" + kSceneFolder, error)) folder_.reset();
    if (!folder_) {
      TESSERA_ASSIGN_OR_RETURN(folder_, TempFolder::Create(options_.work_dir + "/tasks", "task-"));
      for (const char* name : {"/in", "/out"}) TESSERA_RETURN_IF_ERROR(EnsureFolder(folder_->path() + name));
    }
    request.input_dir = folder_->path() + "/in";
    request.output_dir = folder_->path() + "/out";
    return absl::OkStatus();
  }

  void ProbeIfNew() {
    Registration registration;
    {
      std::lock_guard lock(mutex_);
      if (!to_probe_) return;
      to_probe_ = false;
      registration = registration_;
    }
    const bool shared = files_.Probe(registration);
    LogInfo(shared ? "blobs: shared storage" : "blobs: blob service", {{"folder", registration.shared_blob_dir}});
  }

  // Reports to the coordinator, retrying without limit until the worker drains. If the lease is lost, tries once
  // more: it is also lost if the report was accepted but the answer was not received. Returns the next lease if the
  // answer contains one.
  std::optional<LeasedTask> Deliver(const AttemptReport& report, const Attempt& attempt, const LogFields& who) {
    Backoff backoff(options_.retry);
    Status status;
    std::optional<LeasedTask> next;
    for (bool warned = false, last = false;;) {
      status = CallAs([&](const std::string& name) -> Status {
        auto answer = link_.Report(name, report, last_task_ ? 0 : lease_call_);
        if (answer.ok()) next = *std::move(answer);
        return answer.status();
      });
      if (IsAnswered(status) || last) break;
      if (!warned) LogWarning("cannot report; retrying", With(who, "reason", MessageOf(status)));
      warned = true;
      if (!Wait(backoff.NextDelay(status))) {
        if (draining_) break;
        last = true;
      }
    }
    if (!report.succeeded) {
      LogWarning("failed", With(who, "reason", report.failure.message));
    } else if (status.ok()) {
      LogInfo("succeeded", who);
    }
    if (next) ++lease_call_;
    if (status.ok()) return next;
    if (RefusalOf(status) == Refusal::kNotCurrent || attempt.LeaseLost()) {
      LogInfo("report not accepted: the lease is lost", who);
    } else {
      LogError("report failed: result lost", With(who, "reason", MessageOf(status)));
    }
    return std::nullopt;
  }

  void SendHeartbeats() {
    while (true) {
      std::shared_ptr<Attempt> sent;
      {
        std::unique_lock lock(mutex_);
        const double every_s = registration_.heartbeat_s > 0 ? registration_.heartbeat_s : 1.0;
        if (changed_.wait_for(lock, std::chrono::duration<double>(every_s), [&] { return ended_; })) return;
        sent = attempt_;
      }
      std::vector<AttemptProgress> running;
      if (sent != nullptr && !sent->LeaseLost()) running.push_back(sent->Progress());
      std::vector<std::string> stop;
      const Status status = CallAs([&](const std::string& name) -> Status {
        auto answer = link_.Heartbeat(name, running);
        if (answer.ok()) stop = *std::move(answer);
        return answer.status();
      });
      if (!status.ok()) LogDebug("heartbeat failed", {{"reason", MessageOf(status)}});
      for (const std::string& task : stop) {
        // Compare with the attempt that was sent: the same task may have been leased again as a new attempt since.
        if (sent == nullptr || sent->task() != task) continue;
        sent->MarkLeaseLost();
        changed_.notify_all();
      }
    }
  }

  const AgentOptions options_;
  const TaskRunner runner_;
  const FileLock lock_;
  const std::shared_ptr<CallIdentity> identity_;
  const std::shared_ptr<grpc::Channel> channel_;
  CoordinatorLink link_;

  std::mutex registering_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  Registration registration_;         // guarded by mutex_
  bool to_probe_ = false;             // guarded by mutex_: files_ must probe this registration
  std::shared_ptr<Attempt> attempt_;  // guarded by mutex_
  // Guarded by mutex_: since when there is no attempt, or the start.
  const std::chrono::steady_clock::time_point created_ = std::chrono::steady_clock::now();
  std::chrono::steady_clock::time_point idle_since_ = std::chrono::steady_clock::now();
  bool ended_ = false;                  // guarded by mutex_: no further lease follows
  std::atomic<bool> draining_{false};   // written under mutex_
  std::atomic<bool> last_task_{false};  // written under mutex_: lease no task after the current one

  // Only used by the task's thread.
  int64_t lease_call_ = 1;  // unchanged until the call is answered
  TaskFiles files_;
  std::optional<TempFolder> folder_;  // of the previous task
  PeakSampling peaks_;
};

Agent::Agent(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Agent::~Agent() = default;

StatusOr<std::unique_ptr<Agent>> Agent::Create(const AgentOptions& options, TaskRunner runner) {
  auto identity = std::make_shared<CallIdentity>(options.coordinator.token_file);
  TESSERA_ASSIGN_OR_RETURN(auto channel, OpenChannel(options.coordinator, identity));
  TESSERA_RETURN_IF_ERROR(EnsureFolder(options.work_dir));
  TESSERA_ASSIGN_OR_RETURN(FileLock lock, FileLock::Acquire(options.work_dir + "/lock"));
  TESSERA_RETURN_IF_ERROR(RemoveTree(options.work_dir + "/tasks"));  // left by a killed process
  TESSERA_ASSIGN_OR_RETURN(auto cache, BlobCache::Open(options.work_dir + "/cache", options.cache_bytes));
  return std::unique_ptr<Agent>(new Agent(std::make_unique<Impl>(
      options, std::move(runner), std::move(lock), std::move(cache), std::move(identity), std::move(channel))));
}

Status Agent::Run() { return impl_->Run(); }
void Agent::StopLeasing() { impl_->StopLeasing(); }
void Agent::Drain() { impl_->Drain(); }

}  // namespace tessera
