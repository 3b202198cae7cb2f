#include <algorithm>
#include <filesystem>
#include <optional>

#include "common/rpc/status_conversion.h"
#include "server/grpc/conversion.h"
#include "server/grpc/request_bounds.h"
#include "server/grpc/services.h"

namespace tessera {
namespace {

constexpr size_t kMaxSettingsBytes = 64 << 10;

// A token is the index where the next page starts; empty: `by_default`.
StatusOr<int> ParseToken(const std::string& token, int by_default) {
  if (token.empty()) return by_default;
  if (token.size() > 9 || !std::all_of(token.begin(), token.end(), [](char c) { return c >= '0' && c <= '9'; })) {
    return absl::InvalidArgumentError("not a page token: '" + token + "'");
  }
  return std::stoi(token);
}

// Without what makes no other path: "/a/./b/" is "/a/b".
std::string Normal(const std::string& path) {
  std::string normal = std::filesystem::path(path).lexically_normal().string();
  while (normal.size() > 1 && normal.back() == '/') normal.pop_back();
  return normal;
}

// All of it is kept as long as the job.
Status CheckSizes(const v1::CreateJobRequest& request) {
  Faults faults;
  faults.Add(CheckSize("request_id", request.request_id().size(), kMaxNameBytes));
  faults.Add(CheckSize("display_name", request.display_name().size(), kMaxNameBytes));
  faults.Add(CheckSize("scene_path", request.scene_path().size(), kMaxPathBytes));
  faults.Add(CheckSize("settings", request.settings().ByteSizeLong(), kMaxSettingsBytes));
  return faults.ToStatus();
}

StatusOr<JobStatus> Create(const ServerEnvironment& environment, ClientLimits& limits, const DispatchCore& core,
                           Jobs& jobs, const v1::CreateJobRequest& request, const grpc::ServerContext& context) {
  // Also once the deadline has passed.
  const Cancelled cancelled = [&] { return context.IsCancelled() || core.stopped(); };
  const Caller caller = environment.access->CallerOf(context);
  TESSERA_RETURN_IF_ERROR(CheckSizes(request));
  NewJob job;
  job.client = caller.client;
  job.settings = FromProto(request.settings());
  const bool reads_scene = job.settings.update.rollback_to.empty();
  job.request = {request.request_id(), reads_scene ? Normal(request.scene_path()) : "", job.settings};
  if (!request.validate_only()) {
    TESSERA_ASSIGN_OR_RETURN(std::optional<JobStatus> known, jobs.FindRequest(job.request));
    if (known) return *std::move(known);
  }
  // Before the scene is read; whether it can be planned is asked later.
  if (!request.validate_only()) TESSERA_RETURN_IF_ERROR(jobs.MayCreateJob(caller.client));
  TESSERA_ASSIGN_OR_RETURN(const ClientLimits::Ticket reading, limits.Transfer(caller.client, {}));
  TESSERA_RETURN_IF_ERROR(CheckJobSettings(job.settings));
  TESSERA_RETURN_IF_ERROR(CheckPriority(request.priority()));
  job.priority = request.priority();
  job.display_name = request.display_name();
  if (reads_scene) {  // else the base's scene, which is not read again
    if (!std::filesystem::path(request.scene_path()).is_absolute()) {
      return InputError("scene_path", "", "'" + request.scene_path() + "'", "an absolute path");
    }
    if (!environment.scenes_over_network && !caller.local) {
      return absl::FailedPreconditionError(
          "this coordinator reads no scenes for callers from the network: start tesserad with --scene-root FOLDER");
    }
    SceneRequest asked = {job.settings.update.base.empty(), job.settings.classifier};
    if (!asked.needs_mesh) {
      TESSERA_ASSIGN_OR_RETURN(const JobStatus base, jobs.GetJob(job.settings.update.base));
      asked.base_classifies = Classifies(base.header.settings);
    }
    TESSERA_ASSIGN_OR_RETURN(SceneListing scene,
                             environment.list_scene(request.scene_path(), asked, environment.scene_files));
    if (std::binary_search(scene.files.begin(), scene.files.end(), kClassifierFile)) {
      return InputError(scene.folder + "/" + kClassifierFile, "", "a file of this name", "none: it is reserved");
    }
    if (asked.needs_mesh) job.settings.classifier = scene.classifier;
    if (job.display_name.empty()) job.display_name = scene.name;
    job.scene_path = scene.folder;
    job.warnings = scene.warnings;
    TESSERA_ASSIGN_OR_RETURN(job.scene_files, DigestSceneFiles(scene, environment.scene_files, *environment.digests,
                                                               *environment.clock, cancelled));
    if (!scene.classifier_content.empty()) {
      job.classifier = std::move(scene.classifier_content);
      job.scene_files.push_back(
          {kClassifierFile, {Sha256Hex(job.classifier), static_cast<int64_t>(job.classifier.size())}});
    }
  }
  // Whoever asked may have gone meanwhile, and would not know of the job.
  if (context.IsCancelled()) return absl::CancelledError("the caller has gone");
  if (!request.validate_only()) return jobs.CreateJob(job);
  TESSERA_ASSIGN_OR_RETURN(job, jobs.CompleteJob(std::move(job)));
  JobStatus status;
  status.header.display_name = job.display_name;
  status.header.scene_path = job.scene_path;
  status.header.settings = job.settings;
  status.header.warnings = job.warnings;
  return status;
}

}  // namespace

grpc::Status JobsService::CreateJob(grpc::ServerContext* context, const v1::CreateJobRequest* request,
                                    v1::Job* response) {
  const auto job = Create(environment_, limits_, core_, jobs_, *request, *context);
  if (!job.ok()) return ToGrpc(job.status());
  ToProto(*job, response);
  return grpc::Status::OK;
}

grpc::Status JobsService::GetJob(grpc::ServerContext*, const v1::GetJobRequest* request, v1::Job* response) {
  const auto job = jobs_.GetJob(request->name());
  if (!job.ok()) return ToGrpc(job.status());
  ToProto(*job, response);
  return grpc::Status::OK;
}

grpc::Status JobsService::ListJobs(grpc::ServerContext*, const v1::ListJobsRequest* request,
                                   v1::ListJobsResponse* response) {
  const auto before = ParseToken(request->page_token(), -1);
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
  return ToGrpc(jobs_.DeleteJob(request->name(), "asked for"));
}

grpc::Status JobsService::ListTasks(grpc::ServerContext*, const v1::ListTasksRequest* request,
                                    v1::ListTasksResponse* response) {
  const auto first = ParseToken(request->page_token(), 0);
  if (!first.ok()) return ToGrpc(first.status());
  // One more than the page tells whether there is another.
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
  const auto task = ParseToken(token.substr(0, dot), 0);
  const auto number = ParseToken(token.substr(std::min(dot + 1, token.size())), 1);
  for (const auto* part : {&task, &number}) {
    if (!part->ok()) return ToGrpc(absl::InvalidArgumentError("not a page token: '" + token + "'"));
  }
  const auto page = jobs_.ListAttempts(request->parent(), *task, *number, PageSize(request->page_size(), 1000));
  if (!page.ok()) return ToGrpc(page.status());
  const auto go_on_from = [&](int next_task, int next_number) {
    response->set_next_page_token(std::to_string(next_task) + "." + std::to_string(next_number));
  };
  size_t bytes = 0;
  for (const AttemptStatus& attempt : page->attempts) {
    if (bytes > kPageBytes) {
      go_on_from(attempt.task.task, attempt.number);
      return grpc::Status::OK;
    }
    ToProto(attempt, response->add_attempts());
    bytes += response->attempts(response->attempts_size() - 1).ByteSizeLong();
  }
  if (page->next_task >= 0) go_on_from(page->next_task, page->next_number);
  return grpc::Status::OK;
}

}  // namespace tessera
