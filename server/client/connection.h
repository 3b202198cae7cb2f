// The client side of the coordinator's gRPC services.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/rpc/blob_client.h"
#include "common/rpc/channel.h"

namespace tessera {

namespace v1 {
class ChangeJobRequest;
class CreateJobRequest;
class ExportJobRequest;
class GetDemandRequest;
class GetDemandResponse;
class Job;
class ListArtifactsResponse;
class ListAttemptsResponse;
class ListJobsResponse;
class ListTasksResponse;
class ListWorkersResponse;
class RetryJobRequest;
class WatchJobResponse;
}  // namespace v1

// Idempotent calls are retried for a few seconds while the coordinator is unavailable; if the endpoint lists several,
// for as long as a takeover takes. Thread-safe.
class Connection {
 public:
  // UNAVAILABLE if no coordinator answers within `seconds`, or within a takeover if there are several; errors of
  // OpenChannel.
  static StatusOr<std::unique_ptr<Connection>> Open(const Endpoint& endpoint, double seconds = 5);
  ~Connection();

  // Retried only if the request has a request_id or is validate_only.
  Status CreateJob(const v1::CreateJobRequest& request, v1::Job* job);
  // Retried only if the request has a request_id.
  Status ExportJob(const v1::ExportJobRequest& request, v1::Job* job);
  Status GetJob(const std::string& name, v1::Job* job);
  Status CancelJob(const std::string& name, v1::Job* job);
  Status ChangeJob(const v1::ChangeJobRequest& request, v1::Job* job);
  // Never retried: if the first call succeeded, the job is running and a second call is refused.
  Status RetryJob(const v1::RetryJobRequest& request, v1::Job* job);
  Status DeleteJob(const std::string& name);
  // The newest `count` jobs.
  Status ListJobs(int count, v1::ListJobsResponse* jobs);
  // All tasks of a job.
  Status ListTasks(const std::string& job, v1::ListTasksResponse* tasks);
  // All attempts of the tasks of a job.
  Status ListAttempts(const std::string& job, v1::ListAttemptsResponse* attempts);
  // All published files of a job whose names start with `prefix`.
  Status ListArtifacts(const std::string& job, const std::string& prefix, v1::ListArtifactsResponse* artifacts);
  Status ListWorkers(v1::ListWorkersResponse* workers);
  Status GetDemand(const v1::GetDemandRequest& request, v1::GetDemandResponse* demand);
  // Whether the job cannot be planned for its input, or a task failed permanently because its input is wrong; false if
  // this cannot be read.
  bool FailedForInput(const std::string& job);

  // Calls `on_update` with the current state of the job, and again after each change, until the job has ended. A broken
  // stream is resumed when the coordinator is available again. CANCELLED after StopWatching.
  Status WatchJob(const std::string& name, const std::function<void(const v1::WatchJobResponse&)>& on_update);
  // Ends the current and every later WatchJob. May be called from any thread.
  void StopWatching();

  BlobClient& blobs();

 private:
  struct Impl;
  explicit Connection(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
