#include "server/grpc/job_watches.h"

#include <grpcpp/grpcpp.h>
#include <grpcpp/impl/codegen/proto_utils.h>
#include <time.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/printable.h"
#include "common/base/refusal.h"
#include "common/rpc/status_conversion.h"
#include "common/storage/hash.h"
#include "server/grpc/conversion.h"

namespace tessera {
namespace {

using Steady = std::chrono::steady_clock;

constexpr double kInterval_s = 0.25;      // between two messages of a watch
constexpr double kCallersInterval_s = 1;  // between two checks of the callers' tokens
constexpr double kIdle_s = 1;             // longest wait for a change
constexpr double kRestart_s = 1;
constexpr size_t kMaxRunning = 400, kMaxRunningBytes = 64 << 10;
constexpr size_t kMaxLastErrorBytes = 4 << 10;  // error of a running task's previous attempt

double SecondsSince(Steady::time_point start) { return std::chrono::duration<double>(Steady::now() - start).count(); }

double CpuSecondsOfThread() {
  timespec now = {};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

Status Gone() { return absl::CancelledError("cancelled: the caller has disconnected"); }
Status Stops() { return RetryAfter(absl::UnavailableError("unavailable: the coordinator is stopping"), kRestart_s); }

struct Update : JobUpdate {
  grpc::ByteBuffer bytes;  // `message`
};

v1::WatchJobResponse MessageOf(const WatchedJob& watched) {
  v1::WatchJobResponse message;
  ToProto(watched.job, message.mutable_job());
  size_t bytes = 0;
  for (const TaskStatus& task : watched.running) {
    v1::Task& added = *message.add_running();
    ToProto(task, &added);
    if (added.error().message().size() > kMaxLastErrorBytes) {
      added.mutable_error()->set_message(std::string(Prefix(added.error().message(), kMaxLastErrorBytes)));
    }
    bytes += added.ByteSizeLong();
    if (bytes <= kMaxRunningBytes) continue;
    message.mutable_running()->RemoveLast();
    break;
  }
  return message;
}

// Ignores estimates and durations, which change with time alone.
std::string EtagOf(v1::WatchJobResponse message) {
  message.mutable_job()->clear_eta_s();
  message.mutable_job()->clear_eta_low_s();
  message.mutable_job()->clear_eta_high_s();
  std::erase_if(*message.mutable_job()->mutable_waiting_for(), [](char c) { return c >= '0' && c <= '9'; });
  char hex[17];
  std::snprintf(hex, sizeof(hex), "%016llx", static_cast<unsigned long long>(Xxh3(message.SerializeAsString())));
  return hex;
}

}  // namespace

class JobWatches::Watching {
 public:
  Watching(DispatchCore& core, const Jobs& jobs, const Access& access, ClientLimits& limits)
      : core_(core), all_jobs_(jobs), access_(access), limits_(limits), thread_([this] { Run(); }) {}
  ~Watching() { Stop(); }
  void Stop() {
    {
      std::lock_guard lock(mutex_);
      ends_ = true;
    }
    end_.notify_one();
    newer_.notify_all();
    if (thread_.joinable()) thread_.join();
  }

  ClientLimits& limits() { return limits_; }

  class Call;
  grpc::ServerWriteReactor<grpc::ByteBuffer>* Watch(grpc::CallbackServerContext* context,
                                                    const grpc::ByteBuffer& request);
  // As JobWatches::Open: adds a local watch. Sets the number of the state that the caller has seen.
  Status BeginLocal(const std::string& job, const std::string& seen_etag, int64_t* seen, bool* saw_last);
  void EndLocal(const std::string& job);
  // Null: there is no newer one in time. An error ends the watch.
  StatusOr<std::shared_ptr<const JobUpdate>> AwaitNewer(const std::string& job, int64_t seen, double seconds);
  StatusOr<std::shared_ptr<const JobUpdate>> Newest(const std::string& job);

 private:
  // A watched job.
  struct Watched {
    std::shared_ptr<const Update> newest;
    Steady::time_point looked;  // when `newest` was known to be the newest
    int64_t offered = 0;        // number of the newest update that was offered to all watchers
    bool end_waits = false;
    std::set<std::shared_ptr<Call>> calls;
    int locals = 0;
    Status end;  // an error: ends the local watches
  };
  using WatchedJobs = std::map<std::string, Watched>;

  Status BeginWatch(const std::shared_ptr<Call>& call, const grpc::ByteBuffer& request);
  void EndWatch(const std::shared_ptr<Call>& call);
  void Run();
  // Returns true if the end of a job is not stored yet.
  bool TellAll();
  void CheckCallers();
  // Reads the job's newest state.
  Status LookLocked(const std::string& job, Watched& watched);
  std::vector<std::shared_ptr<Call>> AllCalls();

  DispatchCore& core_;
  const Jobs& all_jobs_;
  const Access& access_;
  ClientLimits& limits_;
  std::mutex mutex_;
  std::condition_variable end_, newer_;
  bool ends_ = false;
  WatchedJobs jobs_;
  int64_t updates_ = 0;
  std::thread thread_;  // last
};

// One watch. Calls gRPC without holding its own lock, because gRPC may call back.
class JobWatches::Watching::Call final : public grpc::ServerWriteReactor<grpc::ByteBuffer> {
 public:
  Call(Watching& watching, grpc::CallbackServerContext* context) : watching_(watching), context_(context) {}
  // From here on OnDone deletes it.
  void Hold(std::shared_ptr<Call> self) { self_ = std::move(self); }

  // Sends the update when the message in flight is written, unless a newer one is offered before.
  void Offer(std::shared_ptr<const Update> update) {
    {
      std::lock_guard lock(mutex_);
      if (ended_ || !end_.ok() || (newest_ != nullptr && newest_->number >= update->number)) return;
      newest_ = std::move(update);
      if (under_way_ != nullptr) return;
      under_way_ = newest_;
    }
    StartWrite(&under_way_->bytes);
  }
  // The caller already has this update.
  void Skip(std::shared_ptr<const Update> update) {
    std::lock_guard lock(mutex_);
    if (newest_ == nullptr) newest_ = std::move(update);
  }
  void End(const Status& status) { End(status, false); }
  void OnWriteDone(bool ok) override {
    std::unique_lock lock(mutex_);
    const std::shared_ptr<const Update> sent = std::exchange(under_way_, nullptr);
    if (ok && !sent->last && end_.ok()) {
      if (newest_->number == sent->number) return;
      under_way_ = newest_;
      lock.unlock();
      StartWrite(&under_way_->bytes);
      return;
    }
    const Status status = !end_.ok() ? end_ : ok ? absl::OkStatus() : Gone();
    lock.unlock();
    End(status, true);
  }
  void OnCancel() override { End(Gone()); }
  void OnDone() override {
    {
      std::lock_guard lock(mutex_);
      context_ = nullptr;
    }
    const std::shared_ptr<Call> self = std::move(self_);
    watching_.EndWatch(self);
  }
  bool MayStay() {
    std::lock_guard lock(mutex_);
    return context_ == nullptr || watching_.access_.CallerOf(*context_).roles != 0;
  }

  std::string job;
  ClientLimits::Ticket ticket;

 private:
  // `written`: the message in flight was written.
  void End(const Status& status, bool written) {
    {
      std::lock_guard lock(mutex_);
      if (ended_) return;
      if (!written && under_way_ != nullptr) {
        if (end_.ok()) end_ = status;
        return;
      }
      ended_ = true;
    }
    Finish(ToGrpc(status));
  }

  Watching& watching_;
  std::mutex mutex_;
  grpc::CallbackServerContext* context_;  // null after the call has ended
  std::shared_ptr<const Update> newest_, under_way_;
  Status end_;  // an error: end with it when the message in flight is written
  bool ended_ = false;
  std::shared_ptr<Call> self_;
};

grpc::ServerWriteReactor<grpc::ByteBuffer>* JobWatches::Watching::Watch(grpc::CallbackServerContext* context,
                                                                        const grpc::ByteBuffer& request) {
  const auto call = std::make_shared<Call>(*this, context);
  call->Hold(call);
  const Caller caller = access_.CallerOf(*context);
  auto ticket = limits_.Watch(caller.client);
  Status status = ticket.status();
  if (ticket.ok()) {
    call->ticket = *std::move(ticket);
    status = BeginWatch(call, request);
  }
  if (!status.ok()) call->End(status);
  return call.get();
}

Status JobWatches::Watching::BeginWatch(const std::shared_ptr<Call>& call, const grpc::ByteBuffer& bytes) {
  grpc::ByteBuffer read = bytes;
  v1::WatchJobRequest request;
  if (!grpc::SerializationTraits<v1::WatchJobRequest>::Deserialize(&read, &request).ok()) {
    return absl::InvalidArgumentError("found a malformed message, expected a WatchJobRequest");
  }
  if (core_.stopped()) return Stops();
  std::shared_ptr<const Update> newest;
  {
    std::lock_guard lock(mutex_);
    const auto [job, is_new] = jobs_.try_emplace(request.name());
    if (const Status looked = LookLocked(request.name(), job->second); !looked.ok()) {
      if (is_new) jobs_.erase(job);
      return looked;
    }
    newest = job->second.newest;
    if (is_new) job->second.offered = newest->number;
    call->job = request.name();
    job->second.calls.insert(call);
  }
  if (newest->etag != request.seen_etag()) {
    call->Offer(newest);
  } else if (newest->last) {
    call->End(absl::OkStatus());
  } else {
    call->Skip(newest);
  }
  return absl::OkStatus();
}

void JobWatches::Watching::EndWatch(const std::shared_ptr<Call>& call) {
  call->ticket = {};
  std::lock_guard lock(mutex_);
  const auto job = jobs_.find(call->job);
  if (job == jobs_.end()) return;
  job->second.calls.erase(call);
  if (job->second.calls.empty() && job->second.locals == 0) jobs_.erase(job);
}

Status JobWatches::Watching::BeginLocal(const std::string& name, const std::string& seen_etag, int64_t* seen,
                                        bool* saw_last) {
  if (core_.stopped()) return Stops();
  std::lock_guard lock(mutex_);
  const auto [job, is_new] = jobs_.try_emplace(name);
  Watched& watched = job->second;
  if (const Status looked = LookLocked(name, watched); !looked.ok()) {
    if (is_new) jobs_.erase(job);
    return looked;
  }
  if (is_new) watched.offered = watched.newest->number;
  ++watched.locals;
  if (watched.newest->etag == seen_etag) {
    *seen = watched.newest->number;
    *saw_last = watched.newest->last;
  }
  return absl::OkStatus();
}

void JobWatches::Watching::EndLocal(const std::string& name) {
  std::lock_guard lock(mutex_);
  const auto job = jobs_.find(name);
  if (--job->second.locals == 0 && job->second.calls.empty()) jobs_.erase(job);
}

StatusOr<std::shared_ptr<const JobUpdate>> JobWatches::Watching::AwaitNewer(const std::string& name, int64_t seen,
                                                                            double seconds) {
  std::unique_lock lock(mutex_);
  const Watched& watched = jobs_.at(name);
  const auto ends = [&] { return ends_ || core_.stopped(); };
  newer_.wait_for(lock, std::chrono::duration<double>(seconds),
                  [&] { return ends() || !watched.end.ok() || watched.newest->number > seen; });
  if (ends()) return Stops();
  if (!watched.end.ok()) return watched.end;
  return watched.newest->number > seen ? watched.newest : nullptr;
}

StatusOr<std::shared_ptr<const JobUpdate>> JobWatches::Watching::Newest(const std::string& name) {
  if (core_.stopped()) return Stops();
  std::lock_guard lock(mutex_);
  const auto job = jobs_.find(name);
  if (job != jobs_.end() && SecondsSince(job->second.looked) < 2 * kInterval_s) return job->second.newest;
  Watched unwatched;
  Watched& watched = job == jobs_.end() ? unwatched : job->second;
  TESSERA_RETURN_IF_ERROR(LookLocked(name, watched));
  return watched.newest;
}

Status JobWatches::Watching::LookLocked(const std::string& job, Watched& watched) {
  TESSERA_ASSIGN_OR_RETURN(const WatchedJob looked, all_jobs_.WatchJob(job, kMaxRunning));
  watched.end_waits = looked.end_waits;
  watched.looked = Steady::now();
  watched.end = absl::OkStatus();
  v1::WatchJobResponse message = MessageOf(looked);
  message.set_etag(EtagOf(message));
  if (watched.newest != nullptr && watched.newest->etag == message.etag()) return absl::OkStatus();
  const auto update = std::make_shared<Update>();
  update->number = ++updates_;
  update->etag = message.etag();
  update->last = HasEnded(looked.job.header.state);
  update->message = message.SerializeAsString();
  const grpc::Slice slice(update->message);
  update->bytes = grpc::ByteBuffer(&slice, 1);
  watched.newest = update;
  return absl::OkStatus();
}

bool JobWatches::Watching::TellAll() {
  std::vector<std::string> names;
  {
    std::lock_guard lock(mutex_);
    for (const auto& [name, watched] : jobs_) names.push_back(name);
  }
  bool end_waits = false;
  for (const std::string& name : names) {
    std::vector<std::shared_ptr<Call>> calls;
    std::shared_ptr<const Update> newest;
    Status looked;
    {
      std::lock_guard lock(mutex_);
      const auto job = jobs_.find(name);
      if (job == jobs_.end()) continue;
      Watched& watched = job->second;
      looked = LookLocked(name, watched);
      if (!looked.ok()) watched.end = looked;
      end_waits = end_waits || watched.end_waits;
      if (looked.ok() && watched.offered == watched.newest->number) continue;
      newest = watched.newest;
      watched.offered = newest->number;
      calls.assign(watched.calls.begin(), watched.calls.end());
    }
    newer_.notify_all();
    for (const auto& call : calls) looked.ok() ? call->Offer(newest) : call->End(looked);
  }
  return end_waits;
}

std::vector<std::shared_ptr<JobWatches::Watching::Call>> JobWatches::Watching::AllCalls() {
  std::lock_guard lock(mutex_);
  std::vector<std::shared_ptr<Call>> calls;
  for (const auto& [name, watched] : jobs_) calls.insert(calls.end(), watched.calls.begin(), watched.calls.end());
  return calls;
}

void JobWatches::Watching::CheckCallers() {
  if (!access_.asks_for_tokens()) return;
  for (const auto& call : AllCalls()) {
    if (!call->MayStay())
      call->End(absl::UnauthenticatedError("unauthenticated: the token was revoked or has expired"));
  }
}

void JobWatches::Watching::Run() {
  int64_t version = 0;
  bool end_waits = false;
  Steady::time_point callers_checked = Steady::now();
  while (true) {
    version = core_.WaitForChange(version, end_waits ? kInterval_s : kIdle_s);
    const Steady::time_point start = Steady::now();
    const double begun_cpu_s = CpuSecondsOfThread();
    if (core_.stopped()) {
      newer_.notify_all();
      for (const auto& call : AllCalls()) call->End(Stops());
    } else {
      end_waits = TellAll();
      if (SecondsSince(callers_checked) >= kCallersInterval_s) {
        CheckCallers();
        callers_checked = Steady::now();
      }
    }
    // Limits the message rate, and this thread's use to half of a core.
    const double round_s = std::max(kInterval_s, 2 * (CpuSecondsOfThread() - begun_cpu_s));
    std::unique_lock lock(mutex_);
    if (end_.wait_until(lock,
                        start + std::chrono::duration_cast<Steady::duration>(std::chrono::duration<double>(round_s)),
                        [&] { return ends_; })) {
      return;
    }
  }
}

JobWatches::JobWatches(DispatchCore& core, const Jobs& jobs, const Access* access, ClientLimits* limits)
    : watching_(std::make_unique<Watching>(core, jobs, *access, *limits)) {}
JobWatches::~JobWatches() = default;
void JobWatches::Stop() { watching_->Stop(); }

grpc::ServerWriteReactor<grpc::ByteBuffer>* JobWatches::Watch(grpc::CallbackServerContext* context,
                                                              const grpc::ByteBuffer& request) {
  return watching_->Watch(context, request);
}

JobWatches::Local::~Local() { watching_.EndLocal(job_); }

JobWatches::Local::Event JobWatches::Local::Read(double seconds, std::shared_ptr<const JobUpdate>* update) {
  if (saw_last_ || !status_.ok()) return Event::kEnd;
  auto newer = watching_.AwaitNewer(job_, seen_, seconds);
  if (!newer.ok()) {
    status_ = newer.status();
    return Event::kEnd;
  }
  if (*newer == nullptr) return Event::kTimeout;
  *update = *std::move(newer);
  seen_ = (*update)->number;
  saw_last_ = (*update)->last;
  return Event::kUpdate;
}

StatusOr<std::unique_ptr<JobWatches::Local>> JobWatches::Open(const std::string& client, const std::string& job,
                                                              const std::string& seen_etag) {
  TESSERA_ASSIGN_OR_RETURN(ClientLimits::Ticket ticket, watching_->limits().Watch(client));
  int64_t seen = 0;
  bool saw_last = false;
  TESSERA_RETURN_IF_ERROR(watching_->BeginLocal(job, seen_etag, &seen, &saw_last));
  std::unique_ptr<Local> local(new Local(*watching_, job));
  local->seen_ = seen;
  local->saw_last_ = saw_last;
  local->ticket_ = std::move(ticket);
  return local;
}

StatusOr<std::shared_ptr<const JobUpdate>> JobWatches::Newest(const std::string& job) { return watching_->Newest(job); }

}  // namespace tessera
