// Who may call what: the one place that decides, for every call of every service, before anything reads it.
#ifndef TESSERA_SERVER_AUTH_ACCESS_H_
#define TESSERA_SERVER_AUTH_ACCESS_H_

#include <atomic>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "common/access/tokens.h"
#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/storage/files.h"

namespace grpc {
class AuthMetadataProcessor;
class ServerContextBase;
}  // namespace grpc

namespace tessera {

// Roles as the sum of their bits.
using RoleSet = unsigned;
inline constexpr RoleSet kAllRoles = 15;

// Who makes a call.
struct Caller {
  std::string name;  // of its token; "local": through a socket that its owner alone can open; empty: nobody was asked
  RoleSet roles = 0;
  bool local = false;       // through a socket
  std::string worker = {};  // "workers/W", proved by its secret; empty: none, or not proved
  std::string client = {};  // whose limits count: the name, or the address without its port
  // Of data that a worker moves: its own, for many have one token.
  const std::string& mover() const { return worker.empty() ? client : worker; }
  bool Has(Role role) const { return (roles & static_cast<unsigned>(role)) != 0; }
};

// The roles of which one is needed for a method, "/tessera.v1.Jobs/GetJob"; none: it is not served.
std::optional<RoleSet> RolesFor(const std::string& method);

// Thread-safe.
class Access {
 public:
  // `worker_key`: of the secrets of workers; the same after a restart, or they register anew. `token_file`: empty: who
  // reaches the coordinator may do everything. Both objects must outlive this. Errors of the token file.
  static StatusOr<std::unique_ptr<Access>> Open(const std::string& worker_key, const std::string& token_file,
                                                const Clock* clock);

  bool asks_for_tokens() const { return !token_file_.empty(); }

  // Reads the token file again if it has changed. On an error, which is told once, the tokens known before stay.
  Status Refresh();

  // Where metadata of a call has nothing else to say, an address that gRPC calls `peer`.
  Caller Identify(const std::string& peer, const std::optional<std::string>& authorization) const;
  Caller CallerOf(const grpc::ServerContextBase& context) const;

  // OK, UNAUTHENTICATED or PERMISSION_DENIED; no word about what there is.
  Status Check(const std::string& method, const Caller& caller, bool has_token) const;

  // Asks Check about every call that comes through a listener. Of a listener on a socket if `socket`. Must not outlive
  // this.
  std::shared_ptr<grpc::AuthMetadataProcessor> Processor(bool socket) const;

  std::string SecretOf(const std::string& worker) const;
  // OK if the caller proved to be this worker; else PERMISSION_DENIED, by which an honest worker knows that it has to
  // register again (Refusal::kUnknownWorker).
  static Status CheckWorker(const Caller& caller, const std::string& worker);

 private:
  Access(const std::string& worker_key, const std::string& token_file, const Clock* clock)
      : worker_key_(worker_key), token_file_(token_file), clock_(clock) {}

  const std::string worker_key_;
  const std::string token_file_;
  const Clock* const clock_;
  std::atomic<std::shared_ptr<const TokenTable>> tokens_ = std::make_shared<const TokenTable>();
  std::optional<FileStamp> stamp_;  // of the file when it was last read; of Refresh alone
};

}  // namespace tessera

#endif  // TESSERA_SERVER_AUTH_ACCESS_H_
