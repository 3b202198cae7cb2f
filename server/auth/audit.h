// Audit log: one line for each RPC that changes something, with its caller and outcome.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "common/log/log.h"

namespace google::protobuf {
class MessageLite;
}  // namespace google::protobuf

namespace tessera {

// Whether calls of the method ("/tessera.v1.Jobs/CreateJob") are audited: all that change something, except those that
// workers make for every task (LeaseTask, Heartbeat, ReportTask), which are logged as records.
bool IsAudited(std::string_view method);

// The fields of the request to log; for uploads those of the first message. nullopt if the call changes nothing.
std::optional<LogFields> AuditedRequest(std::string_view method, const google::protobuf::MessageLite& request);
// The name of the job or worker that a successful call created.
LogFields AuditedResponse(std::string_view method, const google::protobuf::MessageLite& response);

// Logs "audit action=CreateJob outcome=OK peer=... user=... job=...". `peer`: the address as gRPC writes it; empty:
// unknown. `user`: name of the token, may be empty. `error`: of a call that was refused or failed.
void LogAudit(std::string_view method, const std::string& peer, const std::string& user, const std::string& outcome,
              const std::string& error, const LogFields& what);

}  // namespace tessera
