#include "common/rpc/channel.h"

#include <grpcpp/grpcpp.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <grpcpp/support/client_interceptor.h>
#include <netdb.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "common/access/secrets.h"
#include "common/rpc/tls_certificates.h"

namespace tessera {
namespace {

namespace experimental = grpc::experimental;

constexpr char kSocketScheme[] = "unix:";
constexpr int kKeepaliveOfListMs = 6'000;  // servers allow one ping every kKeepaliveTimeMs / 4

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

// Owned by the channel. It also holds what must live as long as the channel does.
class IdentityInterceptorFactory final : public experimental::ClientInterceptorFactoryInterface {
 public:
  // Either may be null.
  IdentityInterceptorFactory(std::shared_ptr<CallIdentity> identity, std::shared_ptr<TlsCertificates> certificates)
      : identity_(std::move(identity)), certificates_(std::move(certificates)) {}
  experimental::Interceptor* CreateClientInterceptor(experimental::ClientRpcInfo*) override {
    return identity_ == nullptr ? nullptr : new IdentityInterceptor(*identity_);  // gRPC takes ownership
  }

 private:
  const std::shared_ptr<CallIdentity> identity_;
  const std::shared_ptr<TlsCertificates> certificates_;
};

// Whether every address of an endpoint is local.
bool AreLocal(const std::string& address) {
  if (!IsAddressList(address)) return IsLocalAddress(address);
  const std::vector<std::string> addresses = absl::StrSplit(address, ',');
  return std::all_of(addresses.begin(), addresses.end(), IsLocalAddress);
}

std::string HostOf(const std::string& address) {
  std::string host = address.substr(0, address.rfind(':'));
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') host = host.substr(1, host.size() - 2);
  return host;
}

// Appends the numeric addresses of HOST:PORT to `found`.
Status Resolve(const std::string& address, std::vector<sockaddr_storage>& found) {
  addrinfo hints = {};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_NUMERICSERV;
  addrinfo* list = nullptr;
  const int error =
      ::getaddrinfo(HostOf(address).c_str(), address.substr(address.rfind(':') + 1).c_str(), &hints, &list);
  if (error != 0) {
    return absl::UnavailableError(
        absl::StrCat("cannot find the host of the coordinator ", address, ": ", ::gai_strerror(error)));
  }
  for (const addrinfo* each = list; each != nullptr; each = each->ai_next) {
    std::memcpy(&found.emplace_back(), each->ai_addr, each->ai_addrlen);
  }
  ::freeaddrinfo(list);
  return absl::OkStatus();
}

// A target of gRPC's that holds all addresses of a list, in its order.
StatusOr<std::string> TargetOf(const std::vector<std::string>& addresses) {
  std::vector<sockaddr_storage> found;
  for (const std::string& address : addresses) TESSERA_RETURN_IF_ERROR(Resolve(address, found));
  const bool all_v4 =
      std::all_of(found.begin(), found.end(), [](const auto& each) { return each.ss_family == AF_INET; });
  std::vector<std::string> targets;
  for (const sockaddr_storage& each : found) {
    char host[NI_MAXHOST] = {}, port[NI_MAXSERV] = {};
    if (::getnameinfo(reinterpret_cast<const sockaddr*>(&each), sizeof(each), host, sizeof(host), port, sizeof(port),
                      NI_NUMERICHOST | NI_NUMERICSERV) != 0) {
      return absl::UnavailableError("cannot read an address of " + absl::StrJoin(addresses, ","));
    }
    // gRPC takes one family a target: IPv4 addresses among others are written as IPv6 ones. Brackets are escaped.
    const char* const mapped = each.ss_family == AF_INET ? "::ffff:" : "";
    targets.push_back(all_v4 ? absl::StrCat(host, ":", port) : absl::StrCat("%5B", mapped, host, "%5D:", port));
  }
  return absl::StrCat(all_v4 ? "ipv4:" : "ipv6:", absl::StrJoin(targets, ","));
}

// `address`: of an endpoint. A list's names are resolved now.
StatusOr<std::shared_ptr<grpc::Channel>> Connect(const std::string& address,
                                                 const std::shared_ptr<grpc::ChannelCredentials>& credentials,
                                                 std::shared_ptr<CallIdentity> identity,
                                                 std::shared_ptr<TlsCertificates> certificates = nullptr) {
  grpc::ChannelArguments arguments;
  std::string target = address;
  if (IsAddressList(address)) {
    const std::vector<std::string> addresses = absl::StrSplit(address, ',');
    TESSERA_ASSIGN_OR_RETURN(target, TargetOf(addresses));
    arguments.SetString(GRPC_ARG_DEFAULT_AUTHORITY, addresses.front());
    arguments.SetSslTargetNameOverride(HostOf(addresses.front()));
  }
  // A coordinator of a list that is silent is left sooner: another one may have taken over.
  const bool one_of_many = target != address;
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, one_of_many ? kKeepaliveOfListMs : kKeepaliveTimeMs);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, one_of_many ? kKeepaliveOfListMs : kKeepaliveTimeoutMs);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, one_of_many ? 1'000 : 3'000);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, 1'000);
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetInt(GRPC_ARG_MAX_METADATA_SIZE, 1 << 20);  // room for messages that list all faults of a scene
  arguments.SetMaxReceiveMessageSize(64 << 20);
  std::vector<std::unique_ptr<experimental::ClientInterceptorFactoryInterface>> interceptors;
  interceptors.push_back(std::make_unique<IdentityInterceptorFactory>(std::move(identity), std::move(certificates)));
  return experimental::CreateCustomChannelWithInterceptors(target, credentials, arguments, std::move(interceptors));
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
  const bool good = address.find(',') == std::string::npos && colon != std::string::npos && colon > 0 &&
                    colon + 1 < address.size() &&
                    address.find_first_not_of("0123456789", colon + 1) == std::string::npos;
  if (good) return absl::OkStatus();
  return absl::InvalidArgumentError("address: found '" + address + "', expected HOST:PORT or unix:PATH");
}

bool IsAddressList(const std::string& address) {
  const std::vector<std::string> parts = absl::StrSplit(address, ',');
  // A comma may also be part of a socket's path.
  return parts.size() > 1 && (!IsSocketAddress(address) || std::any_of(parts.begin() + 1, parts.end(), [](auto& part) {
           return CheckAddress(part).ok();
         }));
}

Status CheckEndpointAddress(const std::string& address) {
  if (!IsAddressList(address)) return CheckAddress(address);
  const std::vector<std::string> parts = absl::StrSplit(address, ',');
  for (const std::string& part : parts) {
    if (!IsSocketAddress(part) && CheckAddress(part).ok()) continue;
    return absl::InvalidArgumentError(absl::StrCat("address: found '", part, "' in the list '", address,
                                                   "', expected HOST:PORT,HOST:PORT: a list has no unix:PATH"));
  }
  return absl::OkStatus();
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
  return *Connect(address, grpc::InsecureChannelCredentials(), std::move(identity));
}

StatusOr<std::shared_ptr<grpc::Channel>> OpenChannel(const Endpoint& endpoint, std::shared_ptr<CallIdentity> identity) {
  TESSERA_RETURN_IF_ERROR(CheckEndpointAddress(endpoint.address));
  if (!endpoint.token_file.empty() || !endpoint.tls_key.empty()) DisableCoreDumps();
  if (identity != nullptr) TESSERA_RETURN_IF_ERROR(identity->Check());
  if (endpoint.tls_cert.empty() != endpoint.tls_key.empty()) {
    return absl::InvalidArgumentError("--tls-cert and --tls-key: expected both or neither");
  }
  if (!endpoint.store_ca.empty()) {
    const Status readable = ReadFileRange(endpoint.store_ca, 0, 1).status();
    if (!readable.ok()) return Status(readable.code(), "--s3-ca (AWS_CA_BUNDLE): " + std::string(readable.message()));
  }
  if (IsSocketAddress(endpoint.address)) return MakeChannel(endpoint.address, std::move(identity));
  if (endpoint.tls_ca.empty()) {
    if (!endpoint.tls_cert.empty()) return absl::InvalidArgumentError("--tls-cert requires --tls-ca");
    if (!endpoint.token_file.empty() && !AreLocal(endpoint.address)) {
      return absl::InvalidArgumentError("refusing to send the token unencrypted to " + endpoint.address +
                                        ": pass the certificate authority of the coordinator with --tls-ca FILE");
    }
    return Connect(endpoint.address, grpc::InsecureChannelCredentials(), std::move(identity));
  }
  TESSERA_ASSIGN_OR_RETURN(auto certificates,
                           TlsCertificates::Open({endpoint.tls_cert, endpoint.tls_key, endpoint.tls_ca}));
  experimental::TlsChannelCredentialsOptions tls;
  tls.set_certificate_provider(certificates->provider());
  tls.set_certificate_verifier(std::make_shared<experimental::HostNameCertificateVerifier>());
  tls.watch_root_certs();
  if (!endpoint.tls_cert.empty()) tls.watch_identity_key_cert_pairs();
  return Connect(endpoint.address, experimental::TlsCredentials(tls), std::move(identity), std::move(certificates));
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
