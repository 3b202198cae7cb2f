#include "worker/agent/agent.h"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <new>
#include <optional>
#include <thread>

#include "common/base/parallel.h"
#include "common/base/refusal.h"
#include "common/log/log.h"
#include "common/rpc/blob_client.h"
#include "common/rpc/channel.h"
#include "common/storage/files.h"
#include "worker/agent/attempt.h"
#include "worker/agent/task_files.h"

namespace tessera {
namespace {

constexpr int kMaxForgotten = 3;  // times that one call may find the worker forgotten

// Calls the task and turns whatever it throws into a status: a worker never dies of a task's exception.
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

// Whether a file can be written in the folder, now.
Status TryToWrite(const std::string& folder) {
  const std::string path = folder + "/probe";
  const Status written = WriteFileAtomic(path, std::string(size_t{1} << 20, 'x'));
  TESSERA_RETURN_IF_ERROR(RemoveTree(path));
  return written;
}

// What failed when a task ended with this error, by what can be seen about it: a task reads its inputs and writes to
// its folder, nothing else.
Status JudgeTask(const Status& status, TaskFiles& files, const TaskRequest& request) {
  if (IsFailure(status) || absl::IsCancelled(status)) return status;
  const std::string message = MessageOf(status);
  switch (status.code()) {
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kNotFound:
    case absl::StatusCode::kDataLoss:
    case absl::StatusCode::kOutOfRange:
      if (IsFileError(status)) break;
      // What is wrong with them may have come upon them since they were brought.
      TESSERA_RETURN_IF_ERROR(files.CheckInputs(/*read=*/true));
      return AsStatus(FailureClass::kInput, message);
    default:
      break;
  }
  TESSERA_RETURN_IF_ERROR(files.CheckInputs(/*read=*/false));
  if (IsFileError(status)) return AsStatus(FailureClass::kScratch, message);
  if (absl::IsResourceExhausted(status)) return AsStatus(FailureClass::kMemory, message);
  if (const Status room = TryToWrite(request.output_dir); !room.ok()) {  // libraries do not tell what failed them
    return AsStatus(FailureClass::kScratch, message + "; " + MessageOf(room));
  }
  return AsStatus(FailureClass::kInternal, message);
}

// Whether a report was taken, or never will be. Whatever else is wrong with the coordinator passes.
bool IsAnswered(const Status& report) {
  return report.ok() || absl::IsFailedPrecondition(report) || absl::IsInvalidArgument(report) ||
         absl::IsNotFound(report);
}

LogFields With(LogFields fields, const std::string& key, const std::string& value) {
  fields.emplace_back(key, value);
  return fields;
}

RetryPolicy Endless(RetryPolicy policy) {
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
        files_(BlobClient(channel_, Endless(options.retry), [this](double seconds) { return Wait(seconds); }),
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
      const Status gone = link_.Unregister(worker());
      LogInfo("stopped", {{"worker", worker()}, {"unregistered", gone.ok() ? "yes" : MessageOf(gone)}});
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

  // False, at once, when the worker drains or the attempt at hand is void: nothing is worth waiting for then.
  bool Wait(double seconds) {
    std::unique_lock lock(mutex_);
    return !changed_.wait_for(lock, std::chrono::duration<double>(seconds),
                              [&] { return draining_ || (attempt_ != nullptr && attempt_->IsVoid()); });
  }

  // Registers unless another thread has done so since the worker was called `forgotten`. Waits for the coordinator as
  // long as it takes; CANCELLED when draining.
  Status Register(const std::string& forgotten) {
    std::lock_guard one_at_a_time(registering_);
    if (worker() != forgotten) return absl::OkStatus();
    bool told = false;
    Registration registration;
    const auto call = [&] {
      auto answer = link_.Register(options_.description);
      if (answer.ok()) {
        registration = *std::move(answer);
      } else if (!told) {
        told = true;
        LogWarning("cannot register yet",
                   {{"coordinator", options_.coordinator.address}, {"reason", MessageOf(answer.status())}});
      }
      return answer.status();
    };
    const Status status = Retry(
        Endless(options_.retry), Idempotency::kIdempotent, [this](double seconds) { return WaitToRegister(seconds); },
        call);
    TESSERA_RETURN_IF_ERROR(status);
    identity_->SetWorker(registration.worker, registration.secret);
    std::lock_guard lock(mutex_);
    registration_ = registration;
    to_probe_ = true;
    LogInfo("registered", {{"worker", registration.worker}, {"coordinator", options_.coordinator.address}});
    return absl::OkStatus();
  }

  bool WaitToRegister(double seconds) {
    std::unique_lock lock(mutex_);
    return !changed_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return draining_ || ended_; });
  }

  // Calls `call` with the worker's name; registers again where the coordinator has forgotten it.
  Status CallAs(const std::function<Status(const std::string& worker)>& call) {
    for (int forgotten = 0;; ++forgotten) {
      const std::string name = worker();
      const Status status = call(name);
      if (RefusalOf(status) != Refusal::kUnknownWorker || forgotten >= kMaxForgotten) return status;
      TESSERA_RETURN_IF_ERROR(Register(name));
    }
  }

  Status LeaseLoop() {
    Backoff backoff(options_.retry);
    bool away = false;
    std::optional<LeasedTask> lease;
    while (!draining_ && !last_task_) {
      if (lease) {
        lease = RunLease(*lease);
        continue;
      }
      const Status status = CallAs([&](const std::string& name) -> Status {
        auto answer = link_.Lease(name, options_.lease_wait_s, lease_call_);
        if (answer.ok()) lease = *std::move(answer);
        return answer.status();
      });
      if (draining_) break;
      if (status.ok()) {
        ++lease_call_;
        if (away) LogInfo("coordinator is back", {{"coordinator", options_.coordinator.address}});
        away = false;
        backoff.Reset();
        continue;
      }
      if (RefusalOf(status) == Refusal::kOtherVersion) return status;
      if (!away) LogWarning("coordinator is away", {{"reason", MessageOf(status)}});
      away = true;
      Wait(backoff.NextDelay(status));
    }
    return absl::OkStatus();
  }

  // Gives the next task, if the report's answer brought one.
  std::optional<LeasedTask> RunLease(const LeasedTask& lease) {
    const auto attempt = std::make_shared<Attempt>(lease.task, lease.attempt);
    SetAttempt(attempt);
    const LogFields who = FieldsOf(lease);
    LogInfo("started", With(who, "title", lease.title));
    const AttemptReport report = Work(lease, *attempt);
    std::optional<LeasedTask> next;
    if (attempt->IsVoid()) {
      LogInfo("lease void, work dropped", who);
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
  }

  // Everything from the inputs to the stored outputs.
  AttemptReport Work(const LeasedTask& lease, Attempt& attempt) {
    AttemptReport report;
    report.task = lease.task;
    report.attempt = lease.attempt;
    TaskControl control;
    control.report = [&attempt](double fraction, const std::string& stage) { attempt.SetProgress(fraction, stage); };
    control.cancelled = [this, &attempt] { return draining_ || attempt.IsVoid(); };
    const Status status = WorkIn(lease, control, report);
    files_.Release();
    if (!status.ok()) folder_.reset();  // whatever it left there
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
    TESSERA_RETURN_IF_ERROR(files_.BringInputs(lease.inputs, request.input_dir, control));
    const StatusOr<TaskOutcome> outcome = RunGuarded(runner_, request, control);
    if (!outcome.ok()) return JudgeTask(outcome.status(), files_, request);
    TESSERA_RETURN_IF_ERROR(control.Check());
    TESSERA_RETURN_IF_ERROR(files_.CheckInputs(/*read=*/false));
    TESSERA_ASSIGN_OR_RETURN(report.outputs, files_.StoreOutputs(outcome->outputs, request.output_dir, control));
    report.stats = outcome->stats;
    report.warnings = outcome->warnings;
    report.usage = meter.Read();
    return absl::OkStatus();
  }

  // Folders for a task's files. They are the same for one task after another, as long as each leaves nothing behind: to
  // make them anew costs more than all else about a short task.
  Status MakeFolders(TaskRequest& request) {
    std::error_code error;
    if (folder_ && (!std::filesystem::is_empty(folder_->path() + "/out", error) || error)) folder_.reset();
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
    LogInfo(shared ? "shared storage" : "blob service", {{"folder", registration.shared_blob_dir}});
  }

  // Tells the coordinator, however long it is away; gives up only when draining or when the lease is void: then once
  // more, for it is also void if the report was taken and the answer lost. Gives the next task where the answer brings
  // one.
  std::optional<LeasedTask> Deliver(const AttemptReport& report, const Attempt& attempt, const LogFields& who) {
    Backoff backoff(options_.retry);
    Status status;
    std::optional<LeasedTask> next;
    for (bool told = false, last = false;;) {
      status = CallAs([&](const std::string& name) -> Status {
        auto answer = link_.Report(name, report, last_task_ ? 0 : lease_call_);
        if (answer.ok()) next = *std::move(answer);
        return answer.status();
      });
      if (IsAnswered(status) || last) break;
      if (!told) LogWarning("cannot report yet", With(who, "reason", MessageOf(status)));
      told = true;
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
    if (RefusalOf(status) == Refusal::kNotCurrent || attempt.IsVoid()) {
      LogInfo("report refused: not the current attempt", who);
    } else {
      LogError("could not report", With(who, "reason", MessageOf(status)));
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
      if (sent != nullptr && !sent->IsVoid()) running.push_back(sent->Progress());
      std::vector<std::string> stop;
      const Status status = CallAs([&](const std::string& name) -> Status {
        auto answer = link_.Heartbeat(name, running);
        if (answer.ok()) stop = *std::move(answer);
        return answer.status();
      });
      if (!status.ok()) LogDebug("heartbeat lost", {{"reason", MessageOf(status)}});
      for (const std::string& task : stop) {
        // What was sent, not what runs by now: the same task may have been leased again as a new attempt meanwhile.
        if (sent == nullptr || sent->task() != task) continue;
        sent->MakeVoid();
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
  Registration registration_;           // guarded by mutex_
  bool to_probe_ = false;               // guarded by mutex_: the registration is new to files_
  std::shared_ptr<Attempt> attempt_;    // guarded by mutex_
  bool ended_ = false;                  // guarded by mutex_: no lease will come any more
  std::atomic<bool> draining_{false};   // written under mutex_
  std::atomic<bool> last_task_{false};  // written under mutex_: none is taken after the one at hand

  // Of the task's thread alone.
  int64_t lease_call_ = 1;  // the same until it is answered
  TaskFiles files_;
  std::optional<TempFolder> folder_;  // the last task's
  PeakSampling peaks_;
};

Agent::Agent(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Agent::~Agent() = default;

StatusOr<std::unique_ptr<Agent>> Agent::Create(const AgentOptions& options, TaskRunner runner) {
  auto identity = std::make_shared<CallIdentity>(options.coordinator.token_file);
  TESSERA_ASSIGN_OR_RETURN(auto channel, OpenChannel(options.coordinator, identity));
  TESSERA_RETURN_IF_ERROR(EnsureFolder(options.work_dir));
  TESSERA_ASSIGN_OR_RETURN(FileLock lock, FileLock::Acquire(options.work_dir + "/lock"));
  TESSERA_RETURN_IF_ERROR(RemoveTree(options.work_dir + "/tasks"));  // of a process that was killed
  TESSERA_ASSIGN_OR_RETURN(auto cache, BlobCache::Open(options.work_dir + "/cache", options.cache_bytes));
  return std::unique_ptr<Agent>(new Agent(std::make_unique<Impl>(
      options, std::move(runner), std::move(lock), std::move(cache), std::move(identity), std::move(channel))));
}

Status Agent::Run() { return impl_->Run(); }
void Agent::StopLeasing() { impl_->StopLeasing(); }
void Agent::Drain() { impl_->Drain(); }

}  // namespace tessera
