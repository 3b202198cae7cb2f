#include "worker/agent/coordinator_link.h"

#include <grpcpp/grpcpp.h>

#include <mutex>

#include "common/base/printable.h"
#include "common/rpc/channel.h"
#include "common/rpc/status_conversion.h"
#include "tessera/v1/workers.grpc.pb.h"

namespace tessera {
namespace {

constexpr double kCallSeconds = 10.0;
constexpr double kReportSeconds = 30.0;  // includes the coordinator's durable write
constexpr size_t kMaxTextBytes = 256 << 10;

// Library messages may contain any bytes of any length.
std::string PrintableText(const std::string& text) { return AsUtf8(std::string(Prefix(text, kMaxTextBytes))); }

v1::ErrorClass ToProto(FailureClass failure) {
  switch (failure) {
    case FailureClass::kInput:
      return v1::ERROR_CLASS_INPUT;
    case FailureClass::kLostInput:
      return v1::ERROR_CLASS_LOST_INPUT;
    case FailureClass::kMemory:
      return v1::ERROR_CLASS_MEMORY;
    case FailureClass::kScratch:
      return v1::ERROR_CLASS_SCRATCH;
    case FailureClass::kStorage:
      return v1::ERROR_CLASS_STORAGE;
    case FailureClass::kPeer:
      return v1::ERROR_CLASS_PEER;
    case FailureClass::kPreempted:
      return v1::ERROR_CLASS_PREEMPTED;
    case FailureClass::kInternal:
      break;
  }
  return v1::ERROR_CLASS_INTERNAL;
}

LeasedTask FromProto(const v1::Lease& lease) {
  LeasedTask task;
  task.task = lease.spec().task();
  task.attempt = lease.attempt();
  task.kind = lease.spec().kind();
  task.title = lease.spec().title();
  task.tile = lease.spec().tile();
  task.parameters = lease.spec().parameters_json();
  task.threads = lease.threads();
  for (const v1::InputFile& input : lease.spec().inputs()) {
    task.inputs.push_back({input.name(), {input.digest().sha256(), input.digest().size_bytes()}, input.shared_path()});
  }
  return task;
}

// The lease in an answer that may contain one.
template <class Response>
std::optional<LeasedTask> LeaseIn(const Response& response) {
  return response.has_lease() ? std::optional(FromProto(response.lease())) : std::nullopt;
}

}  // namespace

struct CoordinatorLink::Impl {
  std::unique_ptr<v1::Workers::Stub> stub;
  std::mutex mutex;
  grpc::ClientContext* leasing = nullptr;  // of the running Lease call
  bool stopped = false;
};

CoordinatorLink::CoordinatorLink(std::shared_ptr<grpc::Channel> channel) : impl_(std::make_unique<Impl>()) {
  impl_->stub = v1::Workers::NewStub(std::move(channel));
}

CoordinatorLink::~CoordinatorLink() = default;

StatusOr<Registration> CoordinatorLink::Register(const WorkerDescription& description) {
  grpc::ClientContext context;
  SetDeadline(context, kCallSeconds);
  v1::RegisterWorkerRequest request;
  request.set_host(PrintableText(description.host));
  request.set_pid(description.pid);
  request.set_threads(description.threads);
  request.set_memory_bytes(description.memory_bytes);
  request.set_version(description.version);
  request.set_cores(description.cores);
  request.set_machine(PrintableText(description.machine));
  request.set_allocation(PrintableText(description.allocation));
  request.set_time_left_s(description.time_left_s);
  v1::RegisterWorkerResponse response;
  TESSERA_RETURN_IF_ERROR(FromGrpc(impl_->stub->RegisterWorker(&context, request, &response)));
  Registration registration;
  registration.worker = response.worker();
  registration.secret = response.secret();
  registration.lease_s = response.lease_s();
  registration.heartbeat_s = response.heartbeat_s();
  registration.shared_blob_dir = response.shared_blob_dir();
  registration.shared_probe_path = response.shared_probe_path();
  registration.shared_probe_content = response.shared_probe_content();
  return registration;
}

StatusOr<std::optional<LeasedTask>> CoordinatorLink::Lease(const std::string& worker, double wait_s, int64_t call) {
  grpc::ClientContext context;
  SetDeadline(context, wait_s + kCallSeconds);
  {
    std::lock_guard lock(impl_->mutex);
    if (impl_->stopped) return absl::CancelledError("the worker is stopping: it leases no further tasks");
    impl_->leasing = &context;
  }
  v1::LeaseTaskRequest request;
  request.set_worker(worker);
  request.set_wait_s(wait_s);
  request.set_call(call);
  v1::LeaseTaskResponse response;
  const Status status = FromGrpc(impl_->stub->LeaseTask(&context, request, &response));
  {
    std::lock_guard lock(impl_->mutex);
    impl_->leasing = nullptr;
  }
  TESSERA_RETURN_IF_ERROR(status);
  return LeaseIn(response);
}

void CoordinatorLink::StopLeasing() {
  std::lock_guard lock(impl_->mutex);
  impl_->stopped = true;
  if (impl_->leasing != nullptr) impl_->leasing->TryCancel();
}

StatusOr<std::vector<std::string>> CoordinatorLink::Heartbeat(const std::string& worker,
                                                              const std::vector<AttemptProgress>& running) {
  grpc::ClientContext context;
  SetDeadline(context, kCallSeconds);
  v1::HeartbeatRequest request;
  request.set_worker(worker);
  for (const AttemptProgress& progress : running) {
    v1::TaskProgress* message = request.add_tasks();
    message->set_task(progress.task);
    message->set_attempt(progress.attempt);
    message->set_progress(progress.fraction);
    message->set_stage(PrintableText(progress.stage));
  }
  v1::HeartbeatResponse response;
  TESSERA_RETURN_IF_ERROR(FromGrpc(impl_->stub->Heartbeat(&context, request, &response)));
  return std::vector<std::string>(response.stop_tasks().begin(), response.stop_tasks().end());
}

StatusOr<std::optional<LeasedTask>> CoordinatorLink::Report(const std::string& worker, const AttemptReport& report,
                                                            int64_t lease_call) {
  grpc::ClientContext context;
  SetDeadline(context, kReportSeconds);
  v1::ReportTaskRequest request;
  request.set_worker(worker);
  request.set_task(report.task);
  request.set_attempt(report.attempt);
  if (report.succeeded) {
    v1::TaskResult* success = request.mutable_success();
    for (const NamedDigest& output : report.outputs) {
      v1::OutputFile* message = success->add_outputs();
      message->set_name(output.name);
      message->mutable_digest()->set_sha256(output.digest.sha256);
      message->mutable_digest()->set_size_bytes(output.digest.size_bytes);
    }
    success->set_stats_json(report.stats);
    for (const std::string& warning : report.warnings) success->add_warnings(PrintableText(warning));
    success->mutable_usage()->set_core_seconds(report.usage.core_seconds);
    success->mutable_usage()->set_peak_bytes(report.usage.peak_bytes);
    success->mutable_usage()->set_threads(report.usage.threads);
    request.set_lease_call(lease_call);
  } else {
    v1::TaskError& failure = *request.mutable_failure();
    failure.set_error_class(ToProto(report.failure.failure_class));
    failure.set_message(PrintableText(report.failure.message));
    for (const Digest& digest : report.failure.lost_inputs) {
      v1::Digest& lost = *failure.add_lost_inputs();
      lost.set_sha256(digest.sha256);
      lost.set_size_bytes(digest.size_bytes);
    }
  }
  v1::ReportTaskResponse response;
  TESSERA_RETURN_IF_ERROR(FromGrpc(impl_->stub->ReportTask(&context, request, &response)));
  return LeaseIn(response);
}

Status CoordinatorLink::Unregister(const std::string& worker) {
  grpc::ClientContext context;
  SetDeadline(context, kCallSeconds / 2);
  v1::UnregisterWorkerRequest request;
  request.set_worker(worker);
  v1::UnregisterWorkerResponse response;
  return FromGrpc(impl_->stub->UnregisterWorker(&context, request, &response));
}

}  // namespace tessera
