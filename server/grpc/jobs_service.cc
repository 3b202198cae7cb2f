#include <algorithm>
#include <optional>

#include "common/rpc/status_conversion.h"
#include "server/grpc/conversion.h"
#include "server/grpc/request_bounds.h"
#include "server/grpc/services.h"

namespace tessera {

Submission SubmissionOf(const v1::CreateJobRequest& request, const Caller& caller) {
  return {request.request_id(),
          request.scene_path(),
          request.display_name(),
          FromProto(request.settings()),
          request.priority(),
          caller.client,
          caller.local};
}

grpc::Status JobsService::CreateJob(grpc::ServerContext* context, const v1::CreateJobRequest* request,
                                    v1::Job* response) {
  const Submission submission = SubmissionOf(*request, environment_.access->CallerOf(*context));
  // A call is cancelled also after its deadline.
  const Cancelled cancelled = [&] { return context->IsCancelled() || core_.stopped(); };
  const auto job =
      request->validate_only() ? admission_.Validate(submission, cancelled) : admission_.Submit(submission, cancelled);
  if (!job.ok()) return ToGrpc(job.status());
  ToProto(*job, response);
  return grpc::Status::OK;
}

grpc::Status JobsService::ExportJob(grpc::ServerContext* context, const v1::ExportJobRequest* request,
                                    v1::Job* response) {
  v1::CreateJobRequest create;
  create.set_request_id(request->request_id());
  create.set_display_name(request->display_name());
  create.set_priority(request->priority());
  create.mutable_settings()->mutable_update()->set_base(request->name());
  create.mutable_settings()->mutable_update()->set_export_only(true);
  *create.mutable_settings()->mutable_export_() = request->export_();
  return CreateJob(context, &create, response);
}

grpc::Status JobsService::GetJob(grpc::ServerContext*, const v1::GetJobRequest* request, v1::Job* response) {
  const auto job = jobs_.GetJob(request->name());
  if (!job.ok()) return ToGrpc(job.status());
  ToProto(*job, response);
  return grpc::Status::OK;
}

grpc::Status JobsService::ListJobs(grpc::ServerContext*, const v1::ListJobsRequest* request,
                                   v1::ListJobsResponse* response) {
  const auto before = ParsePageToken(request->page_token(), -1);
  if (!before.ok()) return ToGrpc(before.status());
  const auto jobs = jobs_.ListJobs(*before, PageSize(request->page_size(), 100));
  size_t bytes = 0;
  int last = 0;
  for (const JobStatus& job : jobs) {
    if (bytes > kPageBytes) break;
    ToProto(job, response->add_jobs());
    bytes += response->jobs(response->jobs_size() - 1).ByteSizeLong();
    last = *ParseJobName(job.header.name);
  }
  if (last > 0) response->set_next_page_token(std::to_string(last));
  return grpc::Status::OK;
}

grpc::Status JobsService::CancelJob(grpc::ServerContext*, const v1::CancelJobRequest* request, v1::Job* response) {
  const auto job = jobs_.CancelJob(request->name());
  if (!job.ok()) return ToGrpc(job.status());
  ToProto(*job, response);
  return grpc::Status::OK;
}

grpc::Status JobsService::ChangeJob(grpc::ServerContext*, const v1::ChangeJobRequest* request, v1::Job* response) {
  JobChange change;
  if (request->has_priority()) change.priority = request->priority();
  if (request->has_paused()) change.paused = request->paused();
  const auto job = jobs_.ChangeJob(request->name(), change);
  if (!job.ok()) return ToGrpc(job.status());
  ToProto(*job, response);
  return grpc::Status::OK;
}

grpc::Status JobsService::RetryJob(grpc::ServerContext*, const v1::RetryJobRequest* request, v1::Job* response) {
  const auto job =
      jobs_.RetryJob(request->name(), request->has_tile() ? std::optional<int>(request->tile()) : std::nullopt);
  if (!job.ok()) return ToGrpc(job.status());
  ToProto(*job, response);
  return grpc::Status::OK;
}

grpc::Status JobsService::DeleteJob(grpc::ServerContext*, const v1::DeleteJobRequest* request, v1::DeleteJobResponse*) {
  return ToGrpc(jobs_.DeleteJob(request->name(), "requested by a caller"));
}

grpc::Status JobsService::ListTasks(grpc::ServerContext*, const v1::ListTasksRequest* request,
                                    v1::ListTasksResponse* response) {
  const auto first = ParsePageToken(request->page_token(), 0);
  if (!first.ok()) return ToGrpc(first.status());
  // Request one task more than a page, to detect whether a next page exists.
  const int page_size = PageSize(request->page_size(), 1000);
  const auto tasks = jobs_.ListTasks(request->parent(), *first, page_size + 1);
  if (!tasks.ok()) return ToGrpc(tasks.status());
  size_t bytes = 0;
  for (const TaskStatus& task : *tasks) {
    if (response->tasks_size() == page_size || bytes > kPageBytes) {
      response->set_next_page_token(std::to_string(*first + response->tasks_size()));
      break;
    }
    ToProto(task, response->add_tasks());
    bytes += response->tasks(response->tasks_size() - 1).ByteSizeLong();
  }
  return grpc::Status::OK;
}

grpc::Status JobsService::ListAttempts(grpc::ServerContext*, const v1::ListAttemptsRequest* request,
                                       v1::ListAttemptsResponse* response) {
  // A token is the task and the attempt where the next page starts.
  const std::string& token = request->page_token();
  const size_t dot = std::min(token.find('.'), token.size());
  const auto task = ParsePageToken(token.substr(0, dot), 0);
  const auto number = ParsePageToken(token.substr(std::min(dot + 1, token.size())), 1);
  for (const auto* part : {&task, &number}) {
    if (!part->ok()) return ToGrpc(absl::InvalidArgumentError("malformed page token: '" + token + "'"));
  }
  const auto tile = request->has_tile() ? std::optional<int>(request->tile()) : std::nullopt;
  const auto page = jobs_.ListAttempts(request->parent(), *task, *number, PageSize(request->page_size(), 1000), tile);
  if (!page.ok()) return ToGrpc(page.status());
  const auto set_next_page = [&](int next_task, int next_number) {
    response->set_next_page_token(std::to_string(next_task) + "." + std::to_string(next_number));
  };
  size_t bytes = 0;
  for (const AttemptStatus& attempt : page->attempts) {
    if (bytes > kPageBytes) {
      set_next_page(attempt.task.task, attempt.number);
      return grpc::Status::OK;
    }
    ToProto(attempt, response->add_attempts());
    bytes += response->attempts(response->attempts_size() - 1).ByteSizeLong();
  }
  if (page->next_task >= 0) set_next_page(page->next_task, page->next_number);
  return grpc::Status::OK;
}

}  // namespace tessera
