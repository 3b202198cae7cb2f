#include "server/client/connection.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>

#include "common/base/refusal.h"
#include "common/base/retry/retry.h"
#include "common/rpc/channel.h"
#include "common/rpc/status_conversion.h"
#include "server/client/job_text.h"
#include "tessera/v1/jobs.grpc.pb.h"
#include "tessera/v1/workers.grpc.pb.h"

namespace tessera {
namespace {

constexpr double kCallSeconds = 30;
constexpr double kCreateSeconds = 3600;  // the coordinator hashes every file of a new scene

constexpr double kTakeover_s = 20;  // longer than another coordinator takes to take over

// `takeover`: waits for another coordinator.
RetryPolicy ShortRetry(bool takeover = false) {
  RetryPolicy policy;
  policy.max_attempts = 6;
  policy.max_delay_s = 2;
  if (takeover) policy.max_attempts += static_cast<int>(kTakeover_s / policy.max_delay_s);
  return policy;
}

}  // namespace

struct Connection::Impl {
  RetryPolicy retry;
  std::shared_ptr<grpc::Channel> channel;
  std::unique_ptr<v1::Jobs::Stub> jobs;
  std::unique_ptr<v1::Workers::Stub> workers;
  std::unique_ptr<BlobClient> blobs;

  std::mutex mutex;
  std::condition_variable stopped_changed;
  bool stopped = false;
  grpc::ClientContext* watching = nullptr;

  // Makes a call of `stub` with a fresh context each time.
  template <class Stub, class Request, class Response>
  Status Call(Stub& stub, grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
              const Request& request, Response* response, Idempotency idempotency = Idempotency::kIdempotent,
              double seconds = kCallSeconds) {
    return Retry(retry, idempotency, RealSleeper(), [&] {
      grpc::ClientContext context;
      SetDeadline(context, seconds);
      response->Clear();
      return FromGrpc((stub.*method)(&context, request, response));
    });
  }

  // Calls a list method until it has returned all pages, and adds them to `all`.
  template <class Stub, class Request, class Response>
  Status List(Stub& stub, grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
              Request request, Response* all) {
    Response page;
    do {
      TESSERA_RETURN_IF_ERROR(Call(stub, method, request, &page));
      request.set_page_token(page.next_page_token());
      page.clear_next_page_token();
      all->MergeFrom(page);
    } while (!request.page_token().empty());
    return absl::OkStatus();
  }

  // Sleeps; returns false after StopWatching.
  bool Wait(double seconds) {
    std::unique_lock lock(mutex);
    return !stopped_changed.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return stopped; });
  }
};

Connection::Connection(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Connection::~Connection() = default;

StatusOr<std::unique_ptr<Connection>> Connection::Open(const Endpoint& endpoint, double seconds) {
  auto impl = std::make_unique<Impl>();
  TESSERA_ASSIGN_OR_RETURN(impl->channel, OpenChannel(endpoint, std::make_shared<CallIdentity>(endpoint.token_file)));
  const bool takeover = IsAddressList(endpoint.address);
  impl->retry = ShortRetry(takeover);
  TESSERA_RETURN_IF_ERROR(
      WaitConnected(*impl->channel, endpoint.address, takeover ? std::max(seconds, kTakeover_s) : seconds));
  impl->jobs = v1::Jobs::NewStub(impl->channel);
  impl->workers = v1::Workers::NewStub(impl->channel);
  impl->blobs = std::make_unique<BlobClient>(impl->channel, impl->retry, RealSleeper(), endpoint.store_ca);
  return std::unique_ptr<Connection>(new Connection(std::move(impl)));
}

BlobClient& Connection::blobs() { return *impl_->blobs; }

Status Connection::CreateJob(const v1::CreateJobRequest& request, v1::Job* job) {
  const bool repeatable = !request.request_id().empty() || request.validate_only();
  return impl_->Call(*impl_->jobs, &v1::Jobs::Stub::CreateJob, request, job,
                     repeatable ? Idempotency::kIdempotent : Idempotency::kOnce, kCreateSeconds);
}

Status Connection::ExportJob(const v1::ExportJobRequest& request, v1::Job* job) {
  return impl_->Call(*impl_->jobs, &v1::Jobs::Stub::ExportJob, request, job,
                     request.request_id().empty() ? Idempotency::kOnce : Idempotency::kIdempotent, kCreateSeconds);
}

Status Connection::GetJob(const std::string& name, v1::Job* job) {
  v1::GetJobRequest request;
  request.set_name(name);
  return impl_->Call(*impl_->jobs, &v1::Jobs::Stub::GetJob, request, job);
}

Status Connection::CancelJob(const std::string& name, v1::Job* job) {
  v1::CancelJobRequest request;
  request.set_name(name);
  return impl_->Call(*impl_->jobs, &v1::Jobs::Stub::CancelJob, request, job);
}

Status Connection::ChangeJob(const v1::ChangeJobRequest& request, v1::Job* job) {
  return impl_->Call(*impl_->jobs, &v1::Jobs::Stub::ChangeJob, request, job);
}

Status Connection::RetryJob(const v1::RetryJobRequest& request, v1::Job* job) {
  return impl_->Call(*impl_->jobs, &v1::Jobs::Stub::RetryJob, request, job, Idempotency::kOnce);
}

Status Connection::DeleteJob(const std::string& name) {
  v1::DeleteJobRequest request;
  request.set_name(name);
  v1::DeleteJobResponse response;
  return impl_->Call(*impl_->jobs, &v1::Jobs::Stub::DeleteJob, request, &response);
}

Status Connection::ListJobs(int count, v1::ListJobsResponse* jobs) {
  v1::ListJobsRequest request;
  do {
    request.set_page_size(std::min(1000, count - jobs->jobs_size()));
    v1::ListJobsResponse page;
    TESSERA_RETURN_IF_ERROR(impl_->Call(*impl_->jobs, &v1::Jobs::Stub::ListJobs, request, &page));
    jobs->mutable_jobs()->MergeFrom(page.jobs());
    request.set_page_token(page.next_page_token());
  } while (!request.page_token().empty() && jobs->jobs_size() < count);
  return absl::OkStatus();
}

Status Connection::ListTasks(const std::string& job, v1::ListTasksResponse* tasks) {
  v1::ListTasksRequest request;
  request.set_parent(job);
  return impl_->List(*impl_->jobs, &v1::Jobs::Stub::ListTasks, std::move(request), tasks);
}

Status Connection::ListAttempts(const std::string& job, v1::ListAttemptsResponse* attempts) {
  v1::ListAttemptsRequest request;
  request.set_parent(job);
  return impl_->List(*impl_->jobs, &v1::Jobs::Stub::ListAttempts, std::move(request), attempts);
}

Status Connection::ListArtifacts(const std::string& job, const std::string& prefix,
                                 v1::ListArtifactsResponse* artifacts) {
  v1::ListArtifactsRequest request;
  request.set_parent(job);
  request.set_name_prefix(prefix);
  return impl_->List(*impl_->jobs, &v1::Jobs::Stub::ListArtifacts, std::move(request), artifacts);
}

Status Connection::ListWorkers(v1::ListWorkersResponse* workers) {
  return impl_->List(*impl_->workers, &v1::Workers::Stub::ListWorkers, v1::ListWorkersRequest(), workers);
}

Status Connection::GetDemand(const v1::GetDemandRequest& request, v1::GetDemandResponse* demand) {
  return impl_->Call(*impl_->workers, &v1::Workers::Stub::GetDemand, request, demand);
}

bool Connection::FailedForInput(const std::string& job) {
  v1::Job found;
  if (GetJob(job, &found).ok() && found.bad_input()) return true;
  v1::ListTasksResponse tasks;
  if (!ListTasks(job, &tasks).ok()) return false;
  return std::any_of(tasks.tasks().begin(), tasks.tasks().end(), [](const v1::Task& task) {
    return task.state() == v1::TASK_STATE_FAILED && task.error().error_class() == v1::ERROR_CLASS_INPUT;
  });
}

Status Connection::WatchJob(const std::string& name,
                            const std::function<void(const v1::WatchJobResponse&)>& on_update) {
  v1::WatchJobRequest request;
  request.set_name(name);
  Backoff backoff(ShortRetry());
  bool ended = false;
  while (true) {
    grpc::ClientContext context;
    {
      std::lock_guard lock(impl_->mutex);
      if (impl_->stopped) return absl::CancelledError("no longer watching");
      impl_->watching = &context;
    }
    const auto reader = impl_->jobs->WatchJob(&context, request);
    v1::WatchJobResponse update;
    while (reader->Read(&update)) {
      backoff.Reset();
      ended = HasEnded(update.job().state());
      request.set_seen_etag(update.etag());
      on_update(update);
    }
    const Status status = FromGrpc(reader->Finish());
    {
      std::lock_guard lock(impl_->mutex);
      impl_->watching = nullptr;
      if (impl_->stopped) return absl::CancelledError("no longer watching");
    }
    if (ended) return absl::OkStatus();
    // A new watch that exceeds the client's limit fails at once; a resumed watch waits until the limit allows it.
    const bool waits = RefusalOf(status) != Refusal::kLimit || !request.seen_etag().empty();
    if (!status.ok() && (!waits || !IsTransient(status, Idempotency::kIdempotent))) return status;
    if (!impl_->Wait(backoff.NextDelay(status))) return absl::CancelledError("no longer watching");
  }
}

void Connection::StopWatching() {
  {
    std::lock_guard lock(impl_->mutex);
    impl_->stopped = true;
    if (impl_->watching != nullptr) impl_->watching->TryCancel();
  }
  impl_->stopped_changed.notify_all();
}

}  // namespace tessera
