#include "server/grpc/coordinator_server.h"

#include <google/protobuf/stubs/logging.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/resource_quota.h>
#include <grpcpp/security/auth_metadata_processor.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <optional>

#include "absl/synchronization/mutex.h"
#include "common/access/secrets.h"
#include "common/rpc/channel.h"
#include "common/rpc/tls_certificates.h"
#include "common/storage/files.h"
#include "server/grpc/call_observer.h"
#include "server/grpc/local_calls.h"
#include "server/grpc/services.h"

namespace tessera {
namespace {

// Concurrent calls of one connection; further calls wait in the client. A worker has at most three.
constexpr int kMaxCallsOfConnection = 256;
constexpr int kMaxMessageBytes = 4 << 20;  // of received messages; services limit the size of answers themselves
constexpr size_t kMaxCallMemory = size_t{768} << 20;  // gRPC's memory quota for messages in flight
constexpr int kThreadsBesideTransfers = 500;          // for short calls

// The linked reflection library adds its plugin to every server; this option removes it unless reflection is enabled.
class ReflectionOption final : public grpc::ServerBuilderOption {
 public:
  explicit ReflectionOption(bool wanted) : wanted_(wanted) {}
  void UpdateArguments(grpc::ChannelArguments*) override {}
  void UpdatePlugins(std::vector<std::unique_ptr<grpc::ServerBuilderPlugin>>* plugins) override {
    std::erase_if(*plugins, [](const auto& plugin) { return plugin->name() == kReflectionPlugin; });
    if (wanted_) plugins->push_back(std::make_unique<grpc::reflection::ProtoServerReflectionPlugin>());
  }

 private:
  static constexpr char kReflectionPlugin[] = "proto_server_reflection";
  const bool wanted_;
};

// gRPC replaces an existing socket even if another process listens on it, so check first.
Status CheckSocketIsFree(const std::string& address) {
  const std::string path = address.substr(address.find(':') + 1);
  sockaddr_un name = {};
  name.sun_family = AF_UNIX;
  std::strncpy(name.sun_path, path.c_str(), sizeof(name.sun_path) - 1);
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const bool taken = fd >= 0 && ::connect(fd, reinterpret_cast<const sockaddr*>(&name), sizeof(name)) == 0;
  if (fd >= 0) ::close(fd);
  return taken ? absl::UnavailableError("another process listens on " + path) : absl::OkStatus();
}

// `certificates`: null if the options name none.
StatusOr<std::shared_ptr<grpc::ServerCredentials>> CredentialsFor(const std::string& address,
                                                                  const ListenOptions& options,
                                                                  const TlsCertificates* certificates,
                                                                  const Access& access) {
  std::shared_ptr<grpc::ServerCredentials> credentials;
  if (IsSocketAddress(address)) {
    TESSERA_RETURN_IF_ERROR(CheckSocketIsFree(address));
    credentials = grpc::experimental::LocalServerCredentials(UDS);
  } else if (certificates != nullptr) {
    grpc::experimental::TlsServerCredentialsOptions tls(certificates->provider());
    tls.watch_identity_key_cert_pairs();
    tls.set_cert_request_type(GRPC_SSL_DONT_REQUEST_CLIENT_CERTIFICATE);
    if (!options.tls_ca.empty()) {
      tls.watch_root_certs();
      tls.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
    }
    credentials = grpc::experimental::TlsServerCredentials(tls);
  } else if (IsLocalAddress(address)) {
    credentials = grpc::experimental::LocalServerCredentials(LOCAL_TCP);  // refuses callers of other machines
  } else {
    return grpc::InsecureServerCredentials();  // CheckListenOptions has checked that this is intended
  }
  credentials->SetAuthMetadataProcessor(access.Processor(IsSocketAddress(address)));
  return credentials;
}

}  // namespace

struct CoordinatorServer::Impl {
  explicit Impl(const ServerEnvironment& services_environment)
      : environment(services_environment),
        limits(environment.limits, environment.blobs),
        jobs(environment, limits, environment.coordinator->core(), environment.coordinator->jobs()),
        workers(environment, environment.coordinator->core(), environment.coordinator->leases()),
        blobs(environment, limits, *environment.coordinator) {}

  void SetServing(bool now) {
    if (now == serving) return;
    serving = now;
    grpc::HealthCheckServiceInterface& health = *server->GetHealthCheckService();
    for (const char* service :
         {v1::Jobs::service_full_name(), v1::Workers::service_full_name(), v1::Blobs::service_full_name()}) {
      health.SetServingStatus(service, now);
    }
    health.SetServingStatus(now);
  }

  std::unique_ptr<Access> own_access;
  std::shared_ptr<TlsCertificates> certificates;  // null: no TLS
  const ServerEnvironment environment;
  ClientLimits limits;
  JobsService jobs;
  WorkersService workers;
  BlobsService blobs;
  std::vector<std::string> addresses;
  RpcCounts rpcs{AllMethods()};
  bool draining = false;
  std::optional<bool> serving;  // last state set in the health service; unset: none yet
  std::unique_ptr<grpc::Server> server;
  std::unique_ptr<LocalCalls> local_calls;  // after `server`, which it uses
};

CoordinatorServer::CoordinatorServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

Status CheckListenOptions(const ListenOptions& options, bool asks_for_tokens) {
  if (options.addresses.empty())
    return absl::InvalidArgumentError("--listen: found no address, expected HOST:PORT or unix:PATH");
  if (options.tls_cert.empty() != options.tls_key.empty()) {
    return absl::InvalidArgumentError("--tls-cert and --tls-key: expected both or neither");
  }
  if (!options.tls_ca.empty() && options.tls_cert.empty()) {
    return absl::InvalidArgumentError(
        "--tls-ca: found no --tls-cert and --tls-key, expected both: client certificates need TLS");
  }
  const auto check = [&](const std::string& option, const std::string& address) -> Status {
    TESSERA_RETURN_IF_ERROR(CheckAddress(address));
    if (IsLocalAddress(address)) return absl::OkStatus();
    const bool tls = !options.tls_cert.empty();
    if (asks_for_tokens && !tls) {
      return absl::InvalidArgumentError("tokens on " + address +
                                        " would cross the network unencrypted; pass --tls-cert and --tls-key");
    }
    if (!options.insecure && !asks_for_tokens) {
      return absl::InvalidArgumentError(
          option + " " + address +
          ": found a network address without authentication, expected --tls-cert, --tls-key and --token-file "
          "(`tessera access` creates them), or --insecure if only trusted callers can reach it");
    }
    return absl::OkStatus();
  };
  for (const std::string& address : options.addresses) TESSERA_RETURN_IF_ERROR(check("--listen", address));
  if (!options.http.empty()) {
    if (IsSocketAddress(options.http)) {
      return absl::InvalidArgumentError("--http: found '" + options.http +
                                        "', expected HOST:PORT as in 127.0.0.1:8080");
    }
    TESSERA_RETURN_IF_ERROR(check("--http", options.http));
  }
  if (!options.metrics.empty() && !IsLocalAddress(options.metrics) && !options.open_metrics) {
    return absl::InvalidArgumentError(
        "--metrics-listen " + options.metrics +
        ": found a network address without authentication, expected 127.0.0.1 behind an authenticating proxy, or "
        "--open-metrics if only trusted callers can reach it");
  }
  return absl::OkStatus();
}

StatusOr<std::unique_ptr<CoordinatorServer>> CoordinatorServer::Start(const std::string& address,
                                                                      const ServerEnvironment& environment) {
  ListenOptions options;
  options.addresses = {address};
  return Start(options, environment);
}

StatusOr<std::unique_ptr<CoordinatorServer>> CoordinatorServer::Start(const ListenOptions& options,
                                                                      const ServerEnvironment& environment) {
  ServerEnvironment services = environment;
  std::unique_ptr<Access> own_access;
  if (services.access == nullptr) {
    TESSERA_ASSIGN_OR_RETURN(own_access, Access::Open(RandomSecret(), "", services.clock));
    services.access = own_access.get();
  }
  TESSERA_RETURN_IF_ERROR(CheckListenOptions(options, services.access->asks_for_tokens()));
  // Silence protobuf, which writes a line to standard error for every request with a string that is not UTF-8.
  google::protobuf::SetLogHandler(nullptr);
  // Debian builds Abseil with mutex deadlock detection, whose graph has one global lock: it took 10 % of a busy
  // coordinator's processor time.
  absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
  auto impl = std::make_unique<Impl>(services);
  impl->own_access = std::move(own_access);
  grpc::EnableDefaultHealthCheckService(true);
  grpc::ServerBuilder builder;
  builder.SetOption(std::make_unique<ReflectionOption>(options.reflection));
  grpc::ResourceQuota quota("coordinator");
  quota.Resize(kMaxCallMemory).SetMaxThreads(kThreadsBesideTransfers + environment.limits.all_transfers);
  builder.SetResourceQuota(quota);
  builder.SetMaxReceiveMessageSize(kMaxMessageBytes);
  if (!options.tls_cert.empty()) {
    TESSERA_ASSIGN_OR_RETURN(impl->certificates,
                             TlsCertificates::Open({options.tls_cert, options.tls_key, options.tls_ca}));
  }
  std::vector<int> ports(options.addresses.size());
  for (size_t i = 0; i < ports.size(); ++i) {
    TESSERA_ASSIGN_OR_RETURN(const auto credentials,
                             CredentialsFor(options.addresses[i], options, impl->certificates.get(), *services.access));
    builder.AddListeningPort(options.addresses[i], credentials, &ports[i]);
  }
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);  // a second coordinator on the port is an error
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, kMaxCallsOfConnection);
  builder.AddChannelArgument(GRPC_ARG_ENABLE_CHANNELZ, 0);  // channelz is not served
  AllowKeepalive(builder);
  std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> observers;
  observers.push_back(ObserveCalls(&impl->rpcs, services.access, services.before_reply));
  builder.experimental().SetInterceptorCreators(std::move(observers));
  builder.RegisterService(&impl->jobs);
  builder.RegisterService(&impl->workers);
  builder.RegisterService(&impl->blobs);
  impl->server = builder.BuildAndStart();
  for (size_t i = 0; i < ports.size(); ++i) {
    const std::string& address = options.addresses[i];
    if (impl->server == nullptr || ports[i] == 0) {
      return absl::UnavailableError("cannot listen on " + address);
    }
    impl->addresses.push_back(
        IsSocketAddress(address) ? address : address.substr(0, address.rfind(':') + 1) + std::to_string(ports[i]));
  }
  grpc::ChannelArguments local;
  local.SetMaxReceiveMessageSize(-1);  // services limit the size of answers themselves
  impl->local_calls = std::make_unique<LocalCalls>(impl->server->InProcessChannel(local), services.access);
  std::unique_ptr<CoordinatorServer> server(new CoordinatorServer(std::move(impl)));
  server->Tick();
  return server;
}

CoordinatorServer::~CoordinatorServer() { Shutdown(0); }

const std::string& CoordinatorServer::address() const { return impl_->addresses.front(); }
const std::vector<std::string>& CoordinatorServer::addresses() const { return impl_->addresses; }

LocalCalls& CoordinatorServer::local_calls() { return *impl_->local_calls; }
JobWatches& CoordinatorServer::watches() { return impl_->jobs.watches(); }
std::shared_ptr<TlsCertificates> CoordinatorServer::certificates() const { return impl_->certificates; }
const Access& CoordinatorServer::access() const { return *impl_->environment.access; }

const RpcCounts& CoordinatorServer::rpc_counts() const { return impl_->rpcs; }

void CoordinatorServer::Tick() {
  if (impl_->server == nullptr) return;
  impl_->SetServing(!impl_->draining && impl_->environment.coordinator->core().journal().trouble().ok());
  impl_->limits.BreakOffSilent(ClientLimits::Clock::now());
}

void CoordinatorServer::Drain() {
  impl_->draining = true;
  impl_->environment.coordinator->core().Drain();
  Tick();
}

bool CoordinatorServer::IsBusy() const { return impl_->limits.transfers() > 0; }

void CoordinatorServer::Shutdown(double grace_s) {
  if (impl_->server == nullptr) return;
  impl_->SetServing(false);
  impl_->environment.coordinator->core().Stop();
  impl_->local_calls->Stop();
  impl_->server->Shutdown(std::chrono::system_clock::now() +
                          std::chrono::milliseconds(static_cast<int64_t>(grace_s * 1000)));
  impl_->server->Wait();
  impl_->server.reset();
  impl_->jobs.watches().Stop();
}

}  // namespace tessera
