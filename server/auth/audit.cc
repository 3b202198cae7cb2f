#include "server/auth/audit.h"

#include "tessera/v1/blobs.pb.h"
#include "tessera/v1/jobs.pb.h"
#include "tessera/v1/workers.pb.h"

namespace tessera {
namespace {

using google::protobuf::MessageLite;

// Null if the message is of another type.
template <class Message>
const Message* As(const MessageLite& message) {
  return dynamic_cast<const Message*>(&message);
}

LogFields OfCreate(const v1::CreateJobRequest& request) {
  LogFields fields = {{"scene", request.scene_path()}, {"name", request.display_name()}};
  if (!request.request_id().empty()) fields.emplace_back("request_id", request.request_id());
  const v1::UpdateSettings& update = request.settings().update();
  if (!update.base().empty()) fields.emplace_back("base", update.base());
  if (!update.rollback_to().empty()) fields.emplace_back("rollback_to", update.rollback_to());
  return fields;
}

LogFields OfExport(const v1::ExportJobRequest& request) {
  LogFields fields = {{"base", request.name()}, {"name", request.display_name()}};
  if (!request.request_id().empty()) fields.emplace_back("request_id", request.request_id());
  return fields;
}

LogFields OfChange(const v1::ChangeJobRequest& request) {
  LogFields fields = {{"job", request.name()}};
  if (request.has_priority()) fields.emplace_back("priority", std::to_string(request.priority()));
  if (request.has_paused()) fields.emplace_back("paused", request.paused() ? "yes" : "no");
  return fields;
}

LogFields OfRetry(const v1::RetryJobRequest& request) {
  LogFields fields = {{"job", request.name()}};
  if (request.has_tile()) fields.emplace_back("tile", std::to_string(request.tile()));
  return fields;
}

LogFields OfRegister(const v1::RegisterWorkerRequest& request) {
  return {{"host", request.host()}, {"pid", std::to_string(request.pid())}, {"version", request.version()}};
}

// "CreateJob" of "/tessera.v1.Jobs/CreateJob".
std::string_view Action(std::string_view method) { return method.substr(method.rfind('/') + 1); }

}  // namespace

bool IsAudited(std::string_view method) {
  if (!method.starts_with("/tessera.v1.")) return false;
  for (const char* const action : {"CreateJob", "ExportJob", "CancelJob", "ChangeJob", "RetryJob", "DeleteJob",
                                   "RegisterWorker", "UnregisterWorker", "WriteBlob", "CompleteTransfer"}) {
    if (Action(method) == action) return true;
  }
  return false;
}

std::optional<LogFields> AuditedRequest(std::string_view method, const MessageLite& message) {
  if (!IsAudited(method)) return std::nullopt;
  if (const auto* create = As<v1::CreateJobRequest>(message)) {
    return create->validate_only() ? std::nullopt : std::optional(OfCreate(*create));
  }
  if (const auto* exported = As<v1::ExportJobRequest>(message)) return OfExport(*exported);
  if (const auto* change = As<v1::ChangeJobRequest>(message)) return OfChange(*change);
  if (const auto* retry = As<v1::RetryJobRequest>(message)) return OfRetry(*retry);
  if (const auto* cancel = As<v1::CancelJobRequest>(message)) return LogFields{{"job", cancel->name()}};
  if (const auto* deletion = As<v1::DeleteJobRequest>(message)) return LogFields{{"job", deletion->name()}};
  if (const auto* registration = As<v1::RegisterWorkerRequest>(message)) return OfRegister(*registration);
  if (const auto* leave = As<v1::UnregisterWorkerRequest>(message)) return LogFields{{"worker", leave->worker()}};
  if (const auto* completed = As<v1::CompleteTransferRequest>(message)) {
    return LogFields{{"blob", completed->digest().sha256()},
                     {"bytes", std::to_string(completed->digest().size_bytes())}};
  }
  if (const auto* write = As<v1::WriteBlobRequest>(message)) {
    return LogFields{{"blob", write->digest().sha256()}, {"bytes", std::to_string(write->digest().size_bytes())}};
  }
  return LogFields();
}

LogFields AuditedResponse(std::string_view method, const MessageLite& message) {
  if (Action(method) == "CreateJob" || Action(method) == "ExportJob") {
    if (const auto* job = As<v1::Job>(message)) return {{"job", job->name()}};
  }
  if (const auto* registered = As<v1::RegisterWorkerResponse>(message)) return {{"worker", registered->worker()}};
  return {};
}

void LogAudit(std::string_view method, const std::string& peer, const std::string& user, const std::string& outcome,
              const std::string& error, const LogFields& what) {
  LogFields fields = {{"action", std::string(Action(method))}, {"outcome", outcome}};
  if (!peer.empty()) fields.emplace_back("peer", peer);
  if (!user.empty()) fields.emplace_back("user", user);
  fields.insert(fields.end(), what.begin(), what.end());
  if (!error.empty()) fields.emplace_back("error", error);
  LogInfo("audit", fields);
}

}  // namespace tessera
