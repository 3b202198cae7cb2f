// The client's side of a coordinator's services.
#ifndef TESSERA_SERVER_CLIENT_CONNECTION_H_
#define TESSERA_SERVER_CLIENT_CONNECTION_H_

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/rpc/blob_client.h"
#include "common/rpc/channel.h"

namespace tessera {

namespace v1 {
class Attempt;
class ChangeJobRequest;
class CreateJobRequest;
class Job;
class ListJobsResponse;
class ListTasksResponse;
class ListWorkersResponse;
class RetryJobRequest;
class WatchJobResponse;
}  // namespace v1

// Calls that can be repeated safely are, for a few seconds, when the coordinator is away. Thread-safe.
class Connection {
 public:
  // UNAVAILABLE if nobody answers there within `seconds`; errors of OpenChannel.
  static StatusOr<std::unique_ptr<Connection>> Open(const Endpoint& endpoint, double seconds = 5);
  ~Connection();

  const std::string& address() const;

  // Repeated only if the request has a request_id.
  Status CreateJob(const v1::CreateJobRequest& request, v1::Job* job);
  Status GetJob(const std::string& name, v1::Job* job);
  Status CancelJob(const std::string& name, v1::Job* job);
  Status ChangeJob(const v1::ChangeJobRequest& request, v1::Job* job);
  // Not repeated: the second would be refused, since the job goes on.
  Status RetryJob(const v1::RetryJobRequest& request, v1::Job* job);
  Status DeleteJob(const std::string& name);
  // The newest `count` jobs.
  Status ListJobs(int count, v1::ListJobsResponse* jobs);
  // All tasks of a job.
  Status ListTasks(const std::string& job, v1::ListTasksResponse* tasks);
  // All attempts at tasks of a job.
  Status ListAttempts(const std::string& job, std::vector<v1::Attempt>* attempts);
  Status ListWorkers(v1::ListWorkersResponse* workers);
  // Whether a task of the job failed for good because its input is wrong; false if that cannot be found out.
  bool FailedForInput(const std::string& job);

  // Calls `on_update` with the job's present state and its newest after changes until it has ended. A stream that
  // breaks is taken up where it was, for as long as the coordinator is away. CANCELLED once StopWatching was called.
  Status WatchJob(const std::string& name, const std::function<void(const v1::WatchJobResponse&)>& on_update);
  // Ends WatchJob, now and later. Any thread.
  void StopWatching();

  BlobClient& blobs();

 private:
  struct Impl;
  explicit Connection(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_CLIENT_CONNECTION_H_
