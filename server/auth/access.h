// Authentication and authorization: checks every call of every service before its message is read.
#pragma once

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

// A set of roles as a bit mask.
using RoleSet = unsigned;
inline constexpr RoleSet kAllRoles = 15;

// The caller of an RPC.
struct Caller {
  std::string name;  // of its token; "local": came through the owner's socket; empty: tokens are not required
  RoleSet roles = 0;
  bool local = false;       // came through a socket
  std::string worker = {};  // "workers/W", proved by its secret; empty: no worker, or not proved
  std::string client = {};  // key of the client limits: the name, or the address without its port
  // Key of the transfer limits. Workers are limited one by one, because many share a token.
  const std::string& mover() const { return worker.empty() ? client : worker; }
  bool Has(Role role) const { return (roles & static_cast<unsigned>(role)) != 0; }
};

inline constexpr char kForwardedPeerMetadata[] = "tessera-forwarded-peer";

// The roles that may call a method such as "/tessera.v1.Jobs/GetJob"; nullopt: the method is not served.
std::optional<RoleSet> RolesFor(const std::string& method);

// Thread-safe.
class Access {
 public:
  // `worker_key`: derives the workers' secrets; if it changes at a restart, all workers must register again.
  // `token_file`: empty: no token is required, and every caller may do everything. `clock` must outlive this. Errors of
  // the token file.
  static StatusOr<std::unique_ptr<Access>> Open(const std::string& worker_key, const std::string& token_file,
                                                const Clock* clock);

  bool asks_for_tokens() const { return !token_file_.empty(); }

  // Reads the token file again if it has changed. On an error, which is returned once, the earlier tokens stay valid.
  Status Refresh();

  // `peer`: the address as gRPC writes it. `authorization`: value of the metadata key of that name.
  Caller Identify(const std::string& peer, const std::optional<std::string>& authorization) const;
  Caller CallerOf(const grpc::ServerContextBase& context) const;

  // OK, UNAUTHENTICATED or PERMISSION_DENIED. The message does not reveal whether a resource exists.
  Status Check(const std::string& method, const Caller& caller, bool has_token) const;
  // The same; also audits a refused call that would change something, at a limited rate. `peer` may be empty.
  Status Admit(const std::string& method, const Caller& caller, bool has_token, const std::string& peer) const;

  // Value of the metadata key kForwardedPeerMetadata with which a part of this process makes a call for the caller at
  // `peer`, an address as gRPC writes it. No other process can make such a value.
  std::string ForwardedPeer(const std::string& peer) const;
  // The caller's address: the forwarded one, if this process made the call for another caller.
  std::string PeerOf(const grpc::ServerContextBase& context) const;

  // Runs Check for every call of a listener. `socket`: the listener is a Unix socket. Must not outlive this.
  std::shared_ptr<grpc::AuthMetadataProcessor> Processor(bool socket) const;

  std::string SecretOf(const std::string& worker) const;
  // OK if the caller proved to be this worker; else PERMISSION_DENIED with Refusal::kUnknownWorker, which makes a
  // worker register again.
  static Status CheckWorker(const Caller& caller, const std::string& worker);

 private:
  Access(const std::string& worker_key, const std::string& token_file, const Clock* clock);

  const std::string worker_key_;
  const std::string token_file_;
  const Clock* const clock_;
  std::atomic<std::shared_ptr<const TokenTable>> tokens_ = std::make_shared<const TokenTable>();
  const std::string forwarding_key_;               // of this process
  mutable std::atomic<int64_t> audit_second_ = 0;  // the second that audits_ counts
  mutable std::atomic<int> audits_ = 0;
  std::optional<FileStamp> stamp_;  // of the file when it was last read; used by Refresh only
};

}  // namespace tessera
