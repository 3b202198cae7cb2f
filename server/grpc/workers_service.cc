#include <algorithm>
#include <atomic>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/base/refusal.h"
#include "common/base/version.h"
#include "common/log/log.h"
#include "common/rpc/status_conversion.h"
#include "server/admission/field_bounds.h"
#include "server/demand/demand.h"
#include "server/grpc/conversion.h"
#include "server/grpc/request_bounds.h"
#include "server/grpc/services.h"

namespace tessera {
namespace {

constexpr double kMaxWait_s = 30;  // longest wait of a LeaseTask call
constexpr double kRetryRegister_s = 10;
constexpr size_t kMaxFileNameBytes = 1024;
constexpr double kMaxTimeLeft_s = 1e9;
constexpr double kMaxWorth_s = 1e6;
constexpr int kMaxClasses = 32, kMaxCores = 4096;

Status CheckNames(const v1::TaskResult& result) {
  for (const v1::OutputFile& output : result.outputs()) {
    TESSERA_RETURN_IF_ERROR(CheckSize("outputs.name", output.name().size(), kMaxFileNameBytes));
  }
  return absl::OkStatus();
}

Status CheckRange(const std::string& field, double value, double least, double most) {
  if (value >= least && value <= most) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(field, ": found ", value, ", expected ", least, " to ", most));
}

StatusOr<std::vector<WorkerClass>> ClassesOf(const v1::GetDemandRequest& request) {
  if (request.classes().empty()) return DefaultClasses();
  if (request.classes_size() > kMaxClasses) {
    return absl::InvalidArgumentError(
        absl::StrCat("classes: found ", request.classes_size(), ", expected at most ", kMaxClasses));
  }
  std::vector<WorkerClass> classes;
  int64_t least = 1;
  for (const v1::WorkerClass& each : request.classes()) {
    const std::string place = absl::StrCat("classes[", classes.size(), "].");
    if (each.memory_bytes() < least) {
      return absl::InvalidArgumentError(absl::StrCat(place, "memory_bytes: found ", each.memory_bytes(),
                                                     ", expected at least ", least, ", in ascending order"));
    }
    least = each.memory_bytes();
    TESSERA_RETURN_IF_ERROR(CheckRange(place + "cores", each.cores(), 0, kMaxCores));
    TESSERA_RETURN_IF_ERROR(CheckRange(place + "time_limit_s", each.time_limit_s(), 0, kMaxTimeLeft_s));
    classes.push_back({each.memory_bytes(), std::max(1, each.cores()), each.time_limit_s()});
  }
  return classes;
}

grpc::ServerUnaryReactor* Finished(grpc::CallbackServerContext* context, const Status& status) {
  grpc::ServerUnaryReactor* const reactor = context->DefaultReactor();
  reactor->Finish(ToGrpc(status));
  return reactor;
}

// A LeaseTask call. Finish must be called once. Owns itself.
class LeaseReactor final : public grpc::ServerUnaryReactor {
 public:
  LeaseReactor(Leases& leases, std::string worker) : leases_(leases), worker_(std::move(worker)) {}
  void OnCancel() override { leases_.CheckWaitingCall(worker_); }
  void OnDone() override { delete this; }

 private:
  Leases& leases_;
  const std::string worker_;
};

// A ReportTask call, which may also request the next task: ends when both are answered. Owns itself.
class ReportReactor final : public grpc::ServerUnaryReactor {
 public:
  ReportReactor(v1::ReportTaskResponse* response, bool asks_for_task)
      : response_(response), due_(asks_for_task ? 2 : 1) {}
  void OnDone() override { delete this; }

  // Each is called once, from any thread; Leased only if a task was requested.
  void Reported(const Status& status) {
    if (!status.ok()) refused_ = true;
    reported_ = status;
    EndIfDue();
  }
  void Leased(std::optional<v1::Lease> lease) {
    lease_ = std::move(lease);
    EndIfDue();
  }
  // Whether Reported got an error. Call before both Reported and Leased were called.
  bool refused() const { return refused_; }

 private:
  void EndIfDue() {
    if (--due_ > 0) return;
    if (reported_.ok() && lease_) response_->mutable_lease()->Swap(&*lease_);
    Finish(ToGrpc(reported_));
  }
  v1::ReportTaskResponse* const response_;
  std::atomic<int> due_;
  std::atomic<bool> refused_ = false;
  Status reported_;
  std::optional<v1::Lease> lease_;
};

}  // namespace

// The caller must have proved that it is the named worker.
Status WorkersService::Refused(const Context& context, const std::string& worker) const {
  return Access::CheckWorker(environment_.access->CallerOf(context), worker);
}

grpc::ServerUnaryReactor* WorkersService::RegisterWorker(Context* context, const v1::RegisterWorkerRequest* request,
                                                         v1::RegisterWorkerResponse* response) {
  if (request->version() != kAlgorithmVersion) {
    return Finished(context, Refuse(Refusal::kOtherVersion,
                                    absl::FailedPreconditionError(
                                        "algorithm version: found '" + request->version() + "', expected '" +
                                        kAlgorithmVersion + "'; install the coordinator's version on the worker")));
  }
  for (const auto& [field, text] : {std::pair{"host", &request->host()}, std::pair{"machine", &request->machine()},
                                    std::pair{"allocation", &request->allocation()}}) {
    if (const Status status = CheckSize(field, text->size(), kMaxNameBytes); !status.ok())
      return Finished(context, status);
  }
  if (const Status status = CheckRange("time_left_s", request->time_left_s(), 0, kMaxTimeLeft_s); !status.ok()) {
    return Finished(context, status);
  }
  const StatusOr<std::string> worker =
      leases_.RegisterWorker({request->host(), request->pid(), request->threads(), request->memory_bytes(),
                              request->cores(), request->machine(), environment_.access->CallerOf(*context).client,
                              request->time_left_s(), request->allocation()});
  if (!worker.ok()) return Finished(context, RetryAfter(worker.status(), kRetryRegister_s));
  LogEvent(LogLevel::kInfo, "worker registered",
           {{"worker", *worker}, {"host", request->host()}, {"pid", std::to_string(request->pid())}});
  response->set_worker(*worker);
  response->set_secret(environment_.access->SecretOf(*worker));
  response->set_lease_s(lease_s_);
  response->set_heartbeat_s(std::min(lease_s_ / 4, 1.0));  // at least one per second, to show progress
  if (!environment_.shared_probe_path.empty()) {
    response->set_shared_blob_dir(environment_.shared_blob_dir);
    response->set_shared_probe_path(environment_.shared_probe_path);
    response->set_shared_probe_content(environment_.shared_probe_content);
  }
  return Finished(context, absl::OkStatus());
}

grpc::ServerUnaryReactor* WorkersService::LeaseTask(Context* context, const v1::LeaseTaskRequest* request,
                                                    v1::LeaseTaskResponse* response) {
  if (const Status refused = Refused(*context, request->worker()); !refused.ok()) return Finished(context, refused);
  auto* const reactor = new LeaseReactor(leases_, request->worker());
  LeaseCall call;
  call.worker = request->worker();
  call.wait_s = request->wait_s() > 0 ? std::min(request->wait_s(), kMaxWait_s) : 0.0;
  call.call = request->call();
  call.gone = [context] { return context->IsCancelled(); };
  const bool shared_paths = !environment_.shared_probe_path.empty();
  call.done = [reactor, response, shared_paths](LeaseAnswer answer) {
    if (answer.ok() && *answer) ToProto(**answer, shared_paths, response->mutable_lease());
    reactor->Finish(ToGrpc(answer.status()));
  };
  leases_.LeaseTask(std::move(call));
  return reactor;
}

grpc::ServerUnaryReactor* WorkersService::Heartbeat(Context* context, const v1::HeartbeatRequest* request,
                                                    v1::HeartbeatResponse* response) {
  if (const Status refused = Refused(*context, request->worker()); !refused.ok()) return Finished(context, refused);
  std::vector<ReportedProgress> tasks;
  for (const auto& task : request->tasks()) {
    tasks.push_back({task.task(), task.attempt(), task.progress(), std::string(Prefix(task.stage(), kMaxNameBytes))});
  }
  const auto stop = leases_.Heartbeat(request->worker(), tasks);
  if (!stop.ok()) return Finished(context, stop.status());
  for (const std::string& task : *stop) response->add_stop_tasks(task);
  return Finished(context, absl::OkStatus());
}

grpc::ServerUnaryReactor* WorkersService::ReportTask(Context* context, const v1::ReportTaskRequest* request,
                                                     v1::ReportTaskResponse* response) {
  if (const Status refused = Refused(*context, request->worker()); !refused.ok()) return Finished(context, refused);
  if (const Status names = CheckNames(request->success()); !names.ok()) return Finished(context, names);
  const bool asks_for_task = request->lease_call() > 0 && request->has_success();
  auto* const reactor = new ReportReactor(response, asks_for_task);
  const auto done = [reactor](const Status& status) { reactor->Reported(status); };
  switch (request->result_case()) {
    case v1::ReportTaskRequest::kSuccess:
      leases_.ReportSuccess(request->worker(), request->task(), request->attempt(), FromProto(request->success()),
                            done);
      break;
    case v1::ReportTaskRequest::kFailure:
      leases_.ReportFailure(request->worker(), request->task(), request->attempt(), FromProto(request->failure()),
                            done);
      break;
    case v1::ReportTaskRequest::RESULT_NOT_SET:
      done(absl::InvalidArgumentError("report: found neither success nor failure, expected one of them"));
  }
  if (!asks_for_task) return reactor;
  if (reactor->refused()) {
    reactor->Leased(std::nullopt);
    return reactor;
  }
  LeaseCall call;
  call.worker = request->worker();
  call.call = request->lease_call();
  call.comes_with_report = true;
  call.gone = [context] { return context->IsCancelled(); };
  call.done = [reactor, shared_paths = !environment_.shared_probe_path.empty()](const LeaseAnswer& answer) {
    // An error of leasing is reported by the worker's next LeaseTask call.
    if (!answer.ok() || !*answer) return reactor->Leased(std::nullopt);
    v1::Lease lease;
    ToProto(**answer, shared_paths, &lease);
    reactor->Leased(std::move(lease));
  };
  leases_.LeaseTask(std::move(call));
  return reactor;
}

grpc::ServerUnaryReactor* WorkersService::UnregisterWorker(Context* context, const v1::UnregisterWorkerRequest* request,
                                                           v1::UnregisterWorkerResponse*) {
  if (const Status refused = Refused(*context, request->worker()); !refused.ok()) return Finished(context, refused);
  Reactor* const reactor = context->DefaultReactor();
  leases_.UnregisterWorker(request->worker(), [reactor, worker = request->worker()](const Status& status) {
    if (status.ok()) LogEvent(LogLevel::kInfo, "worker unregistered", {{"worker", worker}});
    reactor->Finish(ToGrpc(status));
  });
  return reactor;
}

grpc::ServerUnaryReactor* WorkersService::ListWorkers(Context* context, const v1::ListWorkersRequest* request,
                                                      v1::ListWorkersResponse* response) {
  const int page_size = PageSize(request->page_size(), kMaxPage);
  size_t bytes = 0;
  // Sorted by name; the page token is the last name of the previous page.
  for (const WorkerStatus& status : leases_.ListWorkers()) {
    if (status.name <= request->page_token()) continue;
    if (response->workers_size() == page_size || bytes > kPageBytes) {
      response->set_next_page_token(response->workers(response->workers_size() - 1).name());
      break;
    }
    v1::Worker& worker = *response->add_workers();
    worker.set_name(status.name);
    worker.set_host(status.info.host);
    worker.set_pid(status.info.pid);
    worker.set_threads(status.info.threads);
    worker.set_memory_bytes(status.info.memory_bytes);
    for (const std::string& task : status.tasks) worker.add_tasks(task);
    worker.set_last_seen_s(status.last_seen_s);
    worker.set_suspended_reason(status.suspended_reason);
    worker.set_suspended_s(status.suspended_s);
    worker.set_allocation(status.info.allocation);
    if (status.time_left_s) worker.set_time_left_s(std::max(0.001, *status.time_left_s));
    bytes += worker.ByteSizeLong();
  }
  return Finished(context, absl::OkStatus());
}

grpc::ServerUnaryReactor* WorkersService::GetDemand(Context* context, const v1::GetDemandRequest* request,
                                                    v1::GetDemandResponse* response) {
  if (const Status status = CheckRange("worth_s", request->worth_s(), 0, kMaxWorth_s); !status.ok()) {
    return Finished(context, status);
  }
  const StatusOr<std::vector<WorkerClass>> classes = ClassesOf(*request);
  if (!classes.ok()) return Finished(context, classes.status());
  std::lock_guard lock(core_.mutex());
  const Ledger& ledger = core_.ledger();
  const Demand demand = DemandOf(ledger, *classes, request->worth_s() > 0 ? request->worth_s() : kWorth_s);
  for (size_t i = 0; i < classes->size(); ++i) {
    v1::Demand& of_class = *response->add_demands();
    of_class.set_memory_bytes((*classes)[i].memory_bytes);
    of_class.set_workers(demand.classes[i].workers);
    of_class.set_core_s(demand.classes[i].core_s);
  }
  for (const TaskRef ref : demand.unfit) {
    const PlannedTask& plan = ledger.task(ref).plan;
    v1::UnfitTask& task = *response->add_unfit();
    task.set_task(TaskName(ref));
    task.set_title(plan.name);
    task.set_memory_bytes(plan.peak_bytes);
    task.set_core_s(plan.cost);
  }
  response->set_unfit_count(demand.unfit_count);
  return Finished(context, absl::OkStatus());
}

}  // namespace tessera
