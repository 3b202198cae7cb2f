#include "server/auth/access.h"

#include <grpcpp/security/auth_metadata_processor.h>
#include <grpcpp/server_context.h>

#include <chrono>
#include <utility>

#include "common/access/secrets.h"
#include "common/base/refusal.h"
#include "common/rpc/channel.h"
#include "common/rpc/status_conversion.h"
#include "server/auth/audit.h"

namespace tessera {
namespace {

constexpr RoleSet kViewer = static_cast<unsigned>(Role::kViewer), kSubmitter = static_cast<unsigned>(Role::kSubmitter),
                  kWorker = static_cast<unsigned>(Role::kWorker), kAdmin = static_cast<unsigned>(Role::kAdmin);
constexpr RoleSet kReaders = kViewer | kSubmitter | kAdmin;
constexpr RoleSet kSubmitters = kSubmitter | kAdmin;

// One row for every served method.
const std::map<std::string, RoleSet>& Rules() {
  static const std::map<std::string, RoleSet> kRules = {
      {"/tessera.v1.Jobs/CreateJob", kSubmitters},
      {"/tessera.v1.Jobs/ExportJob", kSubmitters},
      {"/tessera.v1.Jobs/GetJob", kReaders},
      {"/tessera.v1.Jobs/ListJobs", kReaders},
      {"/tessera.v1.Jobs/CancelJob", kSubmitters},
      {"/tessera.v1.Jobs/ChangeJob", kSubmitters},
      {"/tessera.v1.Jobs/RetryJob", kSubmitters},
      {"/tessera.v1.Jobs/DeleteJob", kAdmin},
      {"/tessera.v1.Jobs/WatchJob", kReaders},
      {"/tessera.v1.Jobs/ListTasks", kReaders},
      {"/tessera.v1.Jobs/ListAttempts", kReaders},
      {"/tessera.v1.Jobs/ListTiles", kReaders},
      {"/tessera.v1.Jobs/ListViews", kReaders},
      {"/tessera.v1.Jobs/LocatePoint", kReaders},
      {"/tessera.v1.Jobs/ListArtifacts", kReaders},
      {"/tessera.v1.Jobs/ListSettings", kReaders},
      {"/tessera.v1.Jobs/QuoteJob", kSubmitters},  // reads a scene, as CreateJob
      {"/tessera.v1.Workers/RegisterWorker", kWorker},
      {"/tessera.v1.Workers/LeaseTask", kWorker},
      {"/tessera.v1.Workers/Heartbeat", kWorker},
      {"/tessera.v1.Workers/ReportTask", kWorker},
      {"/tessera.v1.Workers/UnregisterWorker", kWorker},
      {"/tessera.v1.Workers/ListWorkers", kReaders},
      {"/tessera.v1.Workers/GetDemand", kReaders},
      // BlobsService checks which blobs the caller may read.
      {"/tessera.v1.Blobs/StatBlobs", kAllRoles},
      {"/tessera.v1.Blobs/ReadBlob", kAllRoles},
      {"/tessera.v1.Blobs/WriteBlob", kWorker},
      {"/tessera.v1.Blobs/QueryWrite", kWorker},
      {"/tessera.v1.Blobs/GetTransfers", kAllRoles},
      {"/tessera.v1.Blobs/CompleteTransfer", kWorker},
      {"/grpc.health.v1.Health/Check", kAllRoles},
      {"/grpc.health.v1.Health/Watch", kAllRoles},
      // Served with --reflection only.
      {"/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", kReaders},
  };
  return kRules;
}

// The value of a key; nullopt if the key is missing or occurs more than once (no honest client repeats it).
template <class Metadata>
std::optional<std::string> Single(const Metadata& metadata, const std::string& key) {
  const auto [begin, end] = metadata.equal_range(key);
  if (begin == end || std::next(begin) != end) return std::nullopt;
  return std::string(begin->second.data(), begin->second.size());
}

constexpr int kMaxAuditsPerSecond = 10;

class Gate final : public grpc::AuthMetadataProcessor {
 public:
  Gate(const Access& access, bool socket) : access_(access), socket_(socket) {}
  bool IsBlocking() const override { return false; }
  // All calls of a connection share one auth context, so the caller must not be stored there: handlers use
  // Access::CallerOf.
  grpc::Status Process(const InputMetadata& metadata, grpc::AuthContext*, OutputMetadata*, OutputMetadata*) override {
    const auto authorization = Single(metadata, "authorization");
    const Caller caller = access_.Identify(socket_ ? "unix:" : "", authorization);
    const std::string method = Single(metadata, ":path").value_or("");
    return ToGrpc(access_.Admit(method, caller, authorization.has_value(), ""));
  }

 private:
  const Access& access_;
  const bool socket_;
};

}  // namespace

std::optional<RoleSet> RolesFor(const std::string& method) {
  const auto rule = Rules().find(method);
  return rule == Rules().end() ? std::nullopt : std::optional<RoleSet>(rule->second);
}

Access::Access(const std::string& worker_key, const std::string& token_file, const Clock* clock)
    : worker_key_(worker_key), token_file_(token_file), clock_(clock), forwarding_key_(RandomSecret()) {}

StatusOr<std::unique_ptr<Access>> Access::Open(const std::string& worker_key, const std::string& token_file,
                                               const Clock* clock) {
  std::unique_ptr<Access> access(new Access(worker_key, token_file, clock));
  TESSERA_RETURN_IF_ERROR(access->Refresh());
  return access;
}

Status Access::Refresh() {
  if (token_file_.empty()) return absl::OkStatus();
  const auto stamp = StampOf(token_file_);
  TESSERA_RETURN_IF_ERROR(stamp.status());
  if (stamp_ && *stamp_ == *stamp) return absl::OkStatus();
  stamp_ = *stamp;
  TESSERA_ASSIGN_OR_RETURN(TokenTable table, TokenTable::Read(token_file_));
  tokens_ = std::make_shared<const TokenTable>(std::move(table));
  return absl::OkStatus();
}

Caller Access::Identify(const std::string& peer, const std::optional<std::string>& authorization) const {
  if (peer.starts_with("unix:")) return {"local", kAllRoles, true};
  if (!asks_for_tokens()) return {"", kAllRoles};
  const std::string scheme = "Bearer ";
  if (!authorization || !authorization->starts_with(scheme)) return {};
  const auto tokens = tokens_.load();
  const TokenEntry* const entry = tokens->Find(authorization->substr(scheme.size()));
  if (entry == nullptr || (entry->expires_us > 0 && entry->expires_us <= clock_->UnixTimeUs())) return {};
  return {entry->name, static_cast<unsigned>(entry->role)};
}

Caller Access::CallerOf(const grpc::ServerContextBase& context) const {
  const auto& metadata = context.client_metadata();
  const std::string peer = PeerOf(context);
  Caller caller = Identify(peer, Single(metadata, "authorization"));
  caller.client = caller.name.empty() ? peer.substr(0, peer.rfind(':')) : caller.name;
  const auto worker = Single(metadata, kWorkerMetadata), secret = Single(metadata, kWorkerSecretMetadata);
  if (worker && secret && caller.Has(Role::kWorker) && SameSecret(*secret, SecretOf(*worker))) caller.worker = *worker;
  return caller;
}

Status Access::Check(const std::string& method, const Caller& caller, bool has_token) const {
  if (caller.roles == 0) {
    return absl::UnauthenticatedError(
        has_token
            ? "unauthenticated: the token is unknown or has expired"
            : "unauthenticated: the call carries no token; pass one with --token-file FILE or TESSERA_TOKEN_FILE");
  }
  const auto roles = RolesFor(method);
  if (roles && (caller.roles & *roles) != 0) return absl::OkStatus();
  return absl::PermissionDeniedError("permission denied: '" + caller.name + "' has no role that may call " + method);
}

Status Access::Admit(const std::string& method, const Caller& caller, bool has_token, const std::string& peer) const {
  const Status status = Check(method, caller, has_token);
  if (status.ok() || !IsAudited(method)) return status;
  // Interceptors do not see calls that are refused here. The rate limit keeps an attacker from filling the disk.
  const int64_t second =
      std::chrono::duration_cast<std::chrono::seconds>(std::chrono::steady_clock::now().time_since_epoch()).count();
  if (audit_second_.exchange(second) != second) audits_ = 0;
  if (++audits_ <= kMaxAuditsPerSecond) {
    LogAudit(method, peer, caller.name, std::string(absl::StatusCodeToString(status.code())),
             std::string(status.message()), {});
  }
  return status;
}

std::string Access::ForwardedPeer(const std::string& peer) const { return forwarding_key_ + " " + peer; }

std::string Access::PeerOf(const grpc::ServerContextBase& context) const {
  const auto forwarded = Single(context.client_metadata(), kForwardedPeerMetadata);
  const size_t space = forwarded ? forwarded->find(' ') : std::string::npos;
  if (space == std::string::npos || !SameSecret(forwarded->substr(0, space), forwarding_key_)) return context.peer();
  const std::string peer = forwarded->substr(space + 1);
  // Never the owner's socket, whose callers need no token.
  return peer.starts_with("unix:") ? "" : peer;
}

std::shared_ptr<grpc::AuthMetadataProcessor> Access::Processor(bool socket) const {
  return std::make_shared<Gate>(*this, socket);
}

std::string Access::SecretOf(const std::string& worker) const { return KeyedHash(worker_key_, worker); }

Status Access::CheckWorker(const Caller& caller, const std::string& worker) {
  if (!caller.worker.empty() && caller.worker == worker) return absl::OkStatus();
  return Refuse(Refusal::kUnknownWorker,
                absl::PermissionDeniedError(
                    "permission denied: the call does not carry the secret of this worker; register again"));
}

}  // namespace tessera
