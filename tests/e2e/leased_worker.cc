#include "tests/e2e/leased_worker.h"

#include <grpcpp/grpcpp.h>

#include "common/base/version.h"
#include "common/rpc/channel.h"
#include "common/rpc/status_conversion.h"
#include "tessera/v1/workers.grpc.pb.h"

namespace tessera::e2e {

StatusOr<std::shared_ptr<grpc::Channel>> ConnectLeasedWorker(const std::string& address) {
  const auto identity = std::make_shared<CallIdentity>();
  const auto channel = MakeChannel(address, identity);
  const auto workers = v1::Workers::NewStub(channel);
  grpc::ClientContext registering, leasing;
  v1::RegisterWorkerRequest registration;
  registration.set_version(kAlgorithmVersion);
  registration.set_memory_bytes(int64_t{1} << 40);
  v1::RegisterWorkerResponse registered;
  TESSERA_RETURN_IF_ERROR(FromGrpc(workers->RegisterWorker(&registering, registration, &registered)));
  identity->SetWorker(registered.worker(), registered.secret());
  v1::LeaseTaskRequest request;
  request.set_worker(registered.worker());
  request.set_wait_s(20);
  v1::LeaseTaskResponse leased;
  TESSERA_RETURN_IF_ERROR(FromGrpc(workers->LeaseTask(&leasing, request, &leased)));
  if (!leased.has_lease()) return absl::UnavailableError("no task within 20 s");
  return channel;
}

}  // namespace tessera::e2e
