#include "server/grpc/conversion.h"

#include "common/base/printable.h"

namespace tessera {
namespace {

constexpr size_t kMaxAttemptMessageBytes = 4 << 10;  // a page has a thousand of them
// Limits of reported values, which are stored as long as their jobs.
constexpr size_t kMaxErrorBytes = 256 << 10, kMaxWarningBytes = 4 << 10;
constexpr int kMaxWarnings = 1000;  // per task, and per job in answers
constexpr int kMaxLostInputs = 1000;

std::string Cut(const std::string& text, size_t max_bytes) { return std::string(Prefix(text, max_bytes)); }

// The client is the name of a token, which has no colon, or an address.
std::string TokenNameOf(const std::string& client) { return client.find(':') == std::string::npos ? client : ""; }

google::protobuf::Timestamp ToTimestamp(int64_t time_us) {
  google::protobuf::Timestamp time;
  time.set_seconds(time_us / 1'000'000);
  time.set_nanos(static_cast<int32_t>(time_us % 1'000'000 * 1000));
  return time;
}

}  // namespace

TaskFailure FromProto(const v1::TaskError& error) {
  const bool known = v1::ErrorClass_IsValid(error.error_class());
  TaskFailure failure{known ? static_cast<ErrorClass>(error.error_class()) : ErrorClass::kInternal,
                      Cut(error.message(), kMaxErrorBytes)};
  if (failure.error_class == ErrorClass::kPoison)
    failure.error_class = ErrorClass::kInternal;  // only the coordinator assigns kPoison
  for (const auto& digest : error.lost_inputs()) {
    if (failure.lost_inputs.size() < kMaxLostInputs) failure.lost_inputs.push_back(FromProto(digest));
  }
  return failure;
}

ReportedResult FromProto(const v1::TaskResult& proto) {
  ReportedResult result;
  result.outputs = NamedDigests(proto.outputs());
  result.stats = proto.stats_json();
  for (const std::string& warning : proto.warnings()) {
    if (result.warnings.size() < kMaxWarnings) result.warnings.push_back(Cut(warning, kMaxWarningBytes));
  }
  result.usage = {proto.usage().core_seconds(), proto.usage().peak_bytes(), proto.usage().threads()};
  return result;
}

void ToProto(const JobStatus& status, v1::Job* proto) {
  const JobHeader& header = status.header;
  proto->set_name(header.name);
  proto->set_display_name(header.display_name);
  proto->set_scene_path(header.scene_path);
  ToProto(header.settings, proto->mutable_settings());
  proto->set_state(static_cast<v1::JobState>(header.state));
  proto->set_error(header.error);
  proto->set_bad_input(header.bad_input);
  if (header.create_us != 0) *proto->mutable_create_time() = ToTimestamp(header.create_us);
  if (header.start_us != 0) *proto->mutable_start_time() = ToTimestamp(header.start_us);
  if (header.end_us != 0) *proto->mutable_end_time() = ToTimestamp(header.end_us);
  proto->set_tasks_total(status.tasks_total);
  proto->set_tasks_done(status.tasks_done);
  proto->set_tiles_total(status.tiles_total);
  proto->set_tiles_done(status.tiles_done);
  proto->set_progress(status.progress);
  proto->set_eta_s(status.eta_s);
  proto->set_eta_low_s(status.eta_low_s);
  proto->set_eta_high_s(status.eta_high_s);
  proto->set_core_seconds(status.core_seconds);
  proto->set_predicted_core_seconds(status.predicted_core_seconds);
  proto->set_stage(status.stage);
  proto->set_owner(TokenNameOf(header.client));
  AddFiles(status.artifacts, proto->mutable_artifacts());
  proto->set_artifacts_total(status.artifacts_total);
  for (const std::string& warning : header.warnings) {
    if (proto->warnings_size() < kMaxWarnings) proto->add_warnings(warning);
  }
  proto->set_priority(header.priority);
  proto->set_paused(header.paused);
  proto->set_waiting_for(status.waiting_for);
}

void ToProto(const TaskStatus& status, v1::Task* proto) {
  const JobTask& task = status.task;
  proto->set_name(status.name);
  proto->set_kind(task.plan.kind);
  proto->set_title(task.plan.name);
  proto->set_tile(task.plan.tile);
  proto->set_state(static_cast<v1::TaskState>(task.state));
  proto->set_attempt(task.attempt());
  proto->set_worker(task.worker());
  proto->set_progress(status.progress);
  proto->set_stage(status.stage);
  proto->set_cost(task.plan.cost);
  proto->set_reused(task.reused);
  if (task.error->error_class != ErrorClass::kNone) {
    proto->mutable_error()->set_error_class(static_cast<v1::ErrorClass>(task.error->error_class));
    proto->mutable_error()->set_message(task.error->message);
  }
  proto->set_stats_json(task.stats);
  AddFiles(task.outputs, proto->mutable_outputs());
  if (task.start_us != 0) *proto->mutable_start_time() = ToTimestamp(task.start_us);
  if (task.end_us != 0) *proto->mutable_end_time() = ToTimestamp(task.end_us);
  proto->set_key(task.key_hex());
  for (const std::string& warning : *task.warnings) proto->add_warnings(warning);
  proto->set_predicted_peak_bytes(task.plan.peak_bytes);
  proto->set_superseded(task.superseded);
  if (task.state == TaskState::kSucceeded && !task.reused) {
    proto->mutable_usage()->set_core_seconds(task.usage.core_seconds);
    proto->mutable_usage()->set_peak_bytes(task.usage.peak_bytes);
    proto->mutable_usage()->set_threads(task.usage.threads);
  }
}

void ToProto(const AttemptStatus& status, v1::Attempt* proto) {
  const Attempt& attempt = status.attempt;
  proto->set_task(TaskName(status.task));
  proto->set_attempt(status.number);
  proto->set_kind(status.kind);
  proto->set_title(status.title);
  proto->set_tile(status.tile);
  proto->set_worker(attempt.worker);
  proto->set_machine(attempt.machine);
  *proto->mutable_start_time() = ToTimestamp(attempt.start_us);
  if (attempt.end_us > 0) *proto->mutable_end_time() = ToTimestamp(attempt.end_us);
  proto->set_outcome(static_cast<v1::AttemptOutcome>(OutcomeOf(attempt)));
  if (attempt.failure->error_class == ErrorClass::kNone) return;
  proto->mutable_error()->set_error_class(static_cast<v1::ErrorClass>(attempt.failure->error_class));
  proto->mutable_error()->set_message(std::string(Prefix(attempt.failure->message, kMaxAttemptMessageBytes)));
}

void ToProto(const GrantedLease& lease, bool shared_paths, v1::Lease* proto) {
  v1::TaskSpec& spec = *proto->mutable_spec();
  spec.set_task(lease.task);
  spec.set_kind(lease.plan.kind);
  spec.set_title(lease.plan.name);
  spec.set_parameters_json(lease.plan.parameters);
  spec.set_key(lease.key);
  spec.set_tile(lease.plan.tile);
  for (const LeasedInput& input : lease.inputs) {
    v1::InputFile& added = *spec.add_inputs();
    added.set_name(input.file.name);
    ToProto(input.file.digest, added.mutable_digest());
    if (shared_paths) added.set_shared_path(input.path);
  }
  proto->set_attempt(lease.attempt);
  proto->set_threads(lease.threads);
}

}  // namespace tessera
