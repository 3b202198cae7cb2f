#include <algorithm>

#include "common/base/refusal.h"
#include "common/base/version.h"
#include "common/rpc/status_conversion.h"
#include "server/api/conversion.h"
#include "server/api/logging.h"
#include "server/api/services.h"

namespace tessera {
namespace {

constexpr double kMaxWaitS = 30;  // of a LeaseTask call

}  // namespace

grpc::Status WorkersService::RegisterWorker(grpc::ServerContext*, const v1::RegisterWorkerRequest* request,
                                            v1::RegisterWorkerResponse* response) {
  if (request->version() != kAlgorithmVersion) {
    return ToGrpc(Refuse(Refusal::kOtherVersion,
                         absl::FailedPreconditionError("worker of algorithm version '" + request->version() +
                                                       "', the coordinator has '" + kAlgorithmVersion + "'")));
  }
  const double lease_s = environment_.dispatcher->options().lease_s;
  const std::string worker =
      environment_.dispatcher->RegisterWorker({request->host(), request->pid(), request->threads(),
                                               request->memory_bytes(), request->cores(), request->machine()});
  LogEvent(LogLevel::kInfo, "worker registered",
           {{"worker", worker}, {"host", request->host()}, {"pid", std::to_string(request->pid())}});
  response->set_worker(worker);
  response->set_lease_s(lease_s);
  response->set_heartbeat_s(std::min(lease_s / 4, 1.0));  // progress for people; the lease alone would need fewer
  if (!environment_.shared_probe_path.empty()) {
    response->set_shared_blob_dir(environment_.blobs->root());
    response->set_shared_probe_path(environment_.shared_probe_path);
    response->set_shared_probe_content(environment_.shared_probe_content);
  }
  return grpc::Status::OK;
}

grpc::Status WorkersService::LeaseTask(grpc::ServerContext* context, const v1::LeaseTaskRequest* request,
                                       v1::LeaseTaskResponse* response) {
  const double wait_s = request->wait_s() > 0 ? std::min(request->wait_s(), kMaxWaitS) : 0.0;
  const auto lease = environment_.dispatcher->LeaseTask(
      request->worker(), wait_s, [context] { return context->IsCancelled(); }, request->call());
  if (!lease.ok()) return ToGrpc(lease.status());
  if (*lease) ToProto(**lease, !environment_.shared_probe_path.empty(), response->mutable_lease());
  return grpc::Status::OK;
}

grpc::Status WorkersService::Heartbeat(grpc::ServerContext*, const v1::HeartbeatRequest* request,
                                       v1::HeartbeatResponse* response) {
  std::vector<ReportedProgress> tasks;
  for (const auto& task : request->tasks()) {
    tasks.push_back({task.task(), task.attempt(), task.progress(), task.stage()});
  }
  const auto stop = environment_.dispatcher->Heartbeat(request->worker(), tasks);
  if (!stop.ok()) return ToGrpc(stop.status());
  for (const std::string& task : *stop) response->add_stop_tasks(task);
  return grpc::Status::OK;
}

grpc::Status WorkersService::ReportTask(grpc::ServerContext*, const v1::ReportTaskRequest* request,
                                        v1::ReportTaskResponse*) {
  Dispatcher& dispatcher = *environment_.dispatcher;
  switch (request->result_case()) {
    case v1::ReportTaskRequest::kSuccess:
      return ToGrpc(dispatcher.ReportSuccess(request->worker(), request->task(), request->attempt(),
                                             FromProto(request->success())));
    case v1::ReportTaskRequest::kFailure:
      return ToGrpc(dispatcher.ReportFailure(request->worker(), request->task(), request->attempt(),
                                             FromProto(request->failure())));
    case v1::ReportTaskRequest::RESULT_NOT_SET:
      break;
  }
  return ToGrpc(absl::InvalidArgumentError("a report with neither success nor failure"));
}

grpc::Status WorkersService::UnregisterWorker(grpc::ServerContext*, const v1::UnregisterWorkerRequest* request,
                                              v1::UnregisterWorkerResponse*) {
  const Status status = environment_.dispatcher->UnregisterWorker(request->worker());
  if (status.ok()) LogEvent(LogLevel::kInfo, "worker left", {{"worker", request->worker()}});
  return ToGrpc(status);
}

grpc::Status WorkersService::ListWorkers(grpc::ServerContext*, const v1::ListWorkersRequest*,
                                         v1::ListWorkersResponse* response) {
  for (const WorkerStatus& status : environment_.dispatcher->ListWorkers()) {
    v1::Worker& worker = *response->add_workers();
    worker.set_name(status.name);
    worker.set_host(status.info.host);
    worker.set_pid(status.info.pid);
    worker.set_threads(status.info.threads);
    worker.set_memory_bytes(status.info.memory_bytes);
    for (const std::string& task : status.tasks) worker.add_tasks(task);
    worker.set_last_seen_s(status.last_seen_s);
    worker.set_set_aside_reason(status.set_aside_reason);
    worker.set_set_aside_s(status.set_aside_s);
  }
  return grpc::Status::OK;
}

}  // namespace tessera
