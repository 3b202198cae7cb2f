#include "common/rpc/channel.h"

#include <grpcpp/grpcpp.h>
#include <grpcpp/support/client_interceptor.h>
#include <sys/un.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <vector>

#include "common/access/secrets.h"

namespace tessera {
namespace {

namespace experimental = grpc::experimental;

constexpr char kSocketScheme[] = "unix:";
constexpr int64_t kMaxPemBytes = 4 << 20;

std::chrono::system_clock::time_point After(double seconds) {
  return std::chrono::system_clock::now() + std::chrono::milliseconds(static_cast<int64_t>(seconds * 1000));
}

// Adds the process's credentials to the metadata of every call. gRPC's call credentials work over TLS only, and
// sockets and local addresses use none.
class IdentityInterceptor final : public experimental::Interceptor {
 public:
  explicit IdentityInterceptor(CallIdentity& identity) : identity_(identity) {}
  void Intercept(experimental::InterceptorBatchMethods* methods) override {
    if (methods->QueryInterceptionHookPoint(experimental::InterceptionHookPoints::PRE_SEND_INITIAL_METADATA)) {
      const CallIdentity::Credentials sent = identity_.Get();
      auto& metadata = *methods->GetSendInitialMetadata();
      if (!sent.token.empty()) metadata.insert({"authorization", "Bearer " + sent.token});
      if (!sent.worker.empty()) {
        metadata.insert({kWorkerMetadata, sent.worker});
        metadata.insert({kWorkerSecretMetadata, sent.secret});
      }
    }
    methods->Proceed();
  }

 private:
  CallIdentity& identity_;
};

class IdentityInterceptorFactory final : public experimental::ClientInterceptorFactoryInterface {
 public:
  explicit IdentityInterceptorFactory(std::shared_ptr<CallIdentity> identity) : identity_(std::move(identity)) {}
  experimental::Interceptor* CreateClientInterceptor(experimental::ClientRpcInfo*) override {
    return new IdentityInterceptor(*identity_);  // gRPC takes ownership
  }

 private:
  const std::shared_ptr<CallIdentity> identity_;
};

std::shared_ptr<grpc::Channel> Connect(const std::string& address,
                                       const std::shared_ptr<grpc::ChannelCredentials>& credentials,
                                       std::shared_ptr<CallIdentity> identity) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveTimeMs);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepaliveTimeoutMs);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, 1'000);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 3'000);
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetInt(GRPC_ARG_MAX_METADATA_SIZE, 1 << 20);  // room for messages that list all faults of a scene
  arguments.SetMaxReceiveMessageSize(64 << 20);
  std::vector<std::unique_ptr<experimental::ClientInterceptorFactoryInterface>> interceptors;
  if (identity != nullptr) interceptors.push_back(std::make_unique<IdentityInterceptorFactory>(std::move(identity)));
  return experimental::CreateCustomChannelWithInterceptors(address, credentials, arguments, std::move(interceptors));
}

}  // namespace

std::string DefaultDataFolder() {
  if (const char* data = std::getenv("XDG_DATA_HOME"); data != nullptr && data[0] == '/') {
    return std::string(data) + "/tessera";
  }
  const char* home = std::getenv("HOME");
  return home != nullptr ? std::string(home) + "/.local/share/tessera" : "";
}

std::string DefaultAddress() { return kSocketScheme + DefaultDataFolder() + "/socket"; }

bool IsSocketAddress(const std::string& address) { return address.starts_with(kSocketScheme); }

bool IsLocalAddress(const std::string& address) {
  if (IsSocketAddress(address)) return true;
  const std::string host = address.substr(0, address.rfind(':'));
  if (host == "localhost" || host == "[::1]") return true;
  // Require four numbers: "127.evil.example" is a DNS name.
  return host.starts_with("127.") && host.find_first_not_of("0123456789.") == std::string::npos &&
         std::count(host.begin(), host.end(), '.') == 3;
}

Status CheckAddress(const std::string& address) {
  if (IsSocketAddress(address)) {
    constexpr size_t kMaxBytes = sizeof(sockaddr_un::sun_path) - 1;
    const std::string path = address.substr(std::size(kSocketScheme) - 1);
    if (path.empty() || path[0] != '/') {
      return absl::InvalidArgumentError("address: found '" + address + "', expected an absolute path: unix:/PATH");
    }
    if (path.size() <= kMaxBytes) return absl::OkStatus();
    return absl::InvalidArgumentError("socket path " + path + ": found " + std::to_string(path.size()) +
                                      " bytes, expected at most " + std::to_string(kMaxBytes) +
                                      ": pass a shorter path with --listen unix:PATH");
  }
  const size_t colon = address.rfind(':');
  const bool good = colon != std::string::npos && colon > 0 && colon + 1 < address.size() &&
                    address.find_first_not_of("0123456789", colon + 1) == std::string::npos;
  if (good) return absl::OkStatus();
  return absl::InvalidArgumentError("address: found '" + address + "', expected HOST:PORT or unix:PATH");
}

void CallIdentity::SetWorker(const std::string& worker, const std::string& secret) {
  std::lock_guard lock(mutex_);
  credentials_.worker = worker;
  credentials_.secret = secret;
}

Status CallIdentity::RefreshLocked() {
  if (token_file_.empty()) return absl::OkStatus();
  TESSERA_ASSIGN_OR_RETURN(const FileStamp stamp, StampOf(token_file_));
  if (stamp == stamp_) return absl::OkStatus();
  TESSERA_ASSIGN_OR_RETURN(credentials_.token, ReadSecretFile(token_file_));
  stamp_ = stamp;
  return absl::OkStatus();
}

CallIdentity::Credentials CallIdentity::Get() {
  std::lock_guard lock(mutex_);
  RefreshLocked().IgnoreError();  // keep the previous token; the server rejects it if it is no longer valid
  return credentials_;
}

Status CallIdentity::Check() {
  std::lock_guard lock(mutex_);
  return RefreshLocked();
}

std::shared_ptr<grpc::Channel> MakeChannel(const std::string& address, std::shared_ptr<CallIdentity> identity) {
  return Connect(address, grpc::InsecureChannelCredentials(), std::move(identity));
}

StatusOr<std::shared_ptr<grpc::Channel>> OpenChannel(const Endpoint& endpoint, std::shared_ptr<CallIdentity> identity) {
  TESSERA_RETURN_IF_ERROR(CheckAddress(endpoint.address));
  if (!endpoint.token_file.empty() || !endpoint.tls_key.empty()) DisableCoreDumps();
  if (identity != nullptr) TESSERA_RETURN_IF_ERROR(identity->Check());
  if (endpoint.tls_cert.empty() != endpoint.tls_key.empty()) {
    return absl::InvalidArgumentError("--tls-cert and --tls-key: expected both or neither");
  }
  if (IsSocketAddress(endpoint.address)) return MakeChannel(endpoint.address, std::move(identity));
  if (endpoint.tls_ca.empty()) {
    if (!endpoint.tls_cert.empty()) return absl::InvalidArgumentError("--tls-cert requires --tls-ca");
    if (!endpoint.token_file.empty() && !IsLocalAddress(endpoint.address)) {
      return absl::InvalidArgumentError("refusing to send the token unencrypted to " + endpoint.address +
                                        ": pass the certificate authority of the coordinator with --tls-ca FILE");
    }
    return MakeChannel(endpoint.address, std::move(identity));
  }
  grpc::SslCredentialsOptions tls;
  TESSERA_ASSIGN_OR_RETURN(tls.pem_root_certs, ReadFile(endpoint.tls_ca, kMaxPemBytes));
  if (!endpoint.tls_cert.empty()) {
    TESSERA_ASSIGN_OR_RETURN(tls.pem_cert_chain, ReadFile(endpoint.tls_cert, kMaxPemBytes));
    TESSERA_ASSIGN_OR_RETURN(tls.pem_private_key, ReadFile(endpoint.tls_key, kMaxPemBytes));
  }
  return Connect(endpoint.address, grpc::SslCredentials(tls), std::move(identity));
}

void AllowKeepalive(grpc::ServerBuilder& builder) {
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveTimeMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepaliveTimeoutMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, kKeepaliveTimeMs / 4);
}

Status WaitConnected(grpc::Channel& channel, const std::string& address, double seconds) {
  if (channel.WaitForConnected(After(seconds))) return absl::OkStatus();
  return absl::UnavailableError("no coordinator answers at " + address + ": check that tesserad runs there");
}

void SetDeadline(grpc::ClientContext& context, double seconds) { context.set_deadline(After(std::max(0.0, seconds))); }

}  // namespace tessera
