// Who changed what through RPC, and what came of it: a line of the log for each such call.
#ifndef TESSERA_SERVER_AUTH_AUDIT_H_
#define TESSERA_SERVER_AUTH_AUDIT_H_

#include <optional>
#include <string>
#include <string_view>

#include "common/log/log.h"

namespace google::protobuf {
class MessageLite;
}  // namespace google::protobuf

namespace tessera {

// Whether calls of the method ("/tessera.v1.Jobs/CreateJob") are audited: all that change something, but those that
// workers make for every task (LeaseTask, Heartbeat, ReportTask), whose changes are logged as records.
bool IsAudited(std::string_view method);

// What the call is to change: fields of its request; for uploads the first message. None if nothing is to be.
std::optional<LogFields> AuditedRequest(std::string_view method, const google::protobuf::MessageLite& request);
// What it made, of a call that succeeded: "job" or "worker", where the request does not say.
LogFields AuditedResponse(std::string_view method, const google::protobuf::MessageLite& response);

// "audit action=CreateJob outcome=OK peer=... user=... job=..."; `peer`: where the call comes from, as gRPC writes
// addresses; empty: not known; `user`: of its token, may be empty; `error`: of one that was refused or failed.
void LogAudit(std::string_view method, const std::string& peer, const std::string& user, const std::string& outcome,
              const std::string& error, const LogFields& what);

}  // namespace tessera

#endif  // TESSERA_SERVER_AUTH_AUDIT_H_
