#include "server/api/coordinator_server.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <chrono>
#include <optional>

#include "absl/synchronization/mutex.h"
#include "common/rpc/channel.h"
#include "server/api/call_observer.h"
#include "server/api/services.h"

namespace tessera {
namespace {

// Calls of one connection that are under way; more wait on the caller's side. A worker has three at most.
constexpr int kMaxCallsOfConnection = 256;

}  // namespace

struct CoordinatorServer::Impl {
  explicit Impl(const ServerEnvironment& services_environment)
      : environment(services_environment), jobs(environment), workers(environment), blobs(environment) {}

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

  const ServerEnvironment environment;
  JobsService jobs;
  WorkersService workers;
  BlobsService blobs;
  std::string address;
  RpcCounts rpcs{AllMethods()};
  std::optional<bool> serving;  // what the health service says; none: nothing of each service yet
  std::unique_ptr<grpc::Server> server;
};

CoordinatorServer::CoordinatorServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

StatusOr<std::unique_ptr<CoordinatorServer>> CoordinatorServer::Start(const std::string& address,
                                                                      const ServerEnvironment& environment) {
  const size_t colon = address.rfind(':');
  if (colon == std::string::npos) return absl::InvalidArgumentError("not host:port: '" + address + "'");
  // Debian builds Abseil so that all mutexes of a process, gRPC's too, keep a graph of who is locked after whom under
  // one lock: a tenth of a busy coordinator's processor time.
  absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
  auto impl = std::make_unique<Impl>(environment);
  grpc::EnableDefaultHealthCheckService(true);
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  grpc::ServerBuilder builder;
  int port = 0;
  builder.AddListeningPort(address, grpc::InsecureServerCredentials(), &port);
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);  // a second coordinator on the port is an error
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, kMaxCallsOfConnection);
  builder.AddChannelArgument(GRPC_ARG_ENABLE_CHANNELZ, 0);  // statistics that nobody can ask for
  AllowKeepalive(builder);
  std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> observers;
  observers.push_back(ObserveCalls(&impl->rpcs));
  builder.experimental().SetInterceptorCreators(std::move(observers));
  builder.RegisterService(&impl->jobs);
  builder.RegisterService(&impl->workers);
  builder.RegisterService(&impl->blobs);
  impl->server = builder.BuildAndStart();
  if (impl->server == nullptr || port == 0) return absl::UnavailableError("cannot listen on " + address);
  impl->address = address.substr(0, colon + 1) + std::to_string(port);
  std::unique_ptr<CoordinatorServer> server(new CoordinatorServer(std::move(impl)));
  server->UpdateHealth();
  return server;
}

CoordinatorServer::~CoordinatorServer() { Shutdown(0); }

const std::string& CoordinatorServer::address() const { return impl_->address; }

const RpcCounts& CoordinatorServer::rpc_counts() const { return impl_->rpcs; }

void CoordinatorServer::UpdateHealth() {
  if (impl_->server != nullptr) impl_->SetServing(impl_->environment.dispatcher->storage_trouble().ok());
}

void CoordinatorServer::Shutdown(double grace_s) {
  if (impl_->server == nullptr) return;
  impl_->SetServing(false);
  impl_->environment.dispatcher->Stop();
  impl_->server->Shutdown(std::chrono::system_clock::now() +
                          std::chrono::milliseconds(static_cast<int64_t>(grace_s * 1000)));
  impl_->server->Wait();
  impl_->server.reset();
}

}  // namespace tessera
