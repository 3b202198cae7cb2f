// A coordinator in the bench's own process, on loopback.
#pragma once

#include <memory>
#include <string>
#include <utility>

#include "common/access/certificates.h"
#include "common/access/secrets.h"
#include "common/access/tokens.h"
#include "common/base/clock.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "server/grpc/coordinator_server.h"
#include "server/jobs/coordinator.h"
#include "server/store/state_store.h"

namespace tessera {

class BenchCoordinator {
 public:
  // State and blobs lie in `folder`. `planner` must outlive it. `shared_storage`: workers are told where blobs lie.
  // `tls`: with a certificate by `folder`/ca.pem, and for workers with the token in `folder`/worker.token. `state`: URL
  // of an empty state in place of a database in `folder`; or empty.
  static StatusOr<std::unique_ptr<BenchCoordinator>> Start(const std::string& folder, Planner* planner,
                                                           bool shared_storage, bool tls = false,
                                                           const std::string& state = "") {
    std::unique_ptr<BenchCoordinator> started(new BenchCoordinator);
    TESSERA_ASSIGN_OR_RETURN(started->store_, OpenState(state.empty() ? folder + "/state.sqlite" : state, {}));
    int records = 0;
    TESSERA_RETURN_IF_ERROR(started->store_->Replay([&](const StoredRecord&) { ++records; }));
    if (records > 0) return absl::FailedPreconditionError("found records in the state, expected an empty one");
    TESSERA_ASSIGN_OR_RETURN(started->blobs_, FolderBlobs::Open(folder + "/blobs"));
    TESSERA_ASSIGN_OR_RETURN(started->coordinator_, Coordinator::Open({started->store_.get(), started->blobs_.get(),
                                                                       planner, &started->clock_, /*on_change=*/{}},
                                                                      DispatchOptions()));
    ServerEnvironment environment;
    environment.coordinator = started->coordinator_.get();
    environment.blobs = started->blobs_.get();
    environment.digests = started->store_.get();
    environment.clock = &started->clock_;
    if (shared_storage) {
      environment.shared_blob_dir = started->blobs_->root();
      environment.shared_probe_path = started->blobs_->root() + "/probe";
      environment.shared_probe_content = "probe";
      TESSERA_RETURN_IF_ERROR(WriteFileAtomic(environment.shared_probe_path, environment.shared_probe_content));
    }
    ListenOptions listen;
    listen.addresses = {"127.0.0.1:0"};
    if (tls) {
      TESSERA_RETURN_IF_ERROR(started->MakeKeys(folder, listen));
      environment.access = started->access_.get();
    }
    TESSERA_ASSIGN_OR_RETURN(started->server_, CoordinatorServer::Start(listen, environment));
    return started;
  }

  Coordinator& coordinator() { return *coordinator_; }
  BlobStore& blobs() { return *blobs_; }
  const std::string& address() const { return server_->address(); }
  CoordinatorServer& server() { return *server_; }

 private:
  BenchCoordinator() = default;

  Status MakeKeys(const std::string& folder, ListenOptions& listen) {
    const int64_t now_s = clock_.UnixTimeUs() / 1'000'000;
    TESSERA_ASSIGN_OR_RETURN(const Certificate ca, MakeAuthority({"bench", {}, now_s, -3600, 86400}));
    TESSERA_ASSIGN_OR_RETURN(const Certificate own,
                             MakeCertificate(ca, {"server", {"127.0.0.1"}, now_s, -3600, 86400}));
    listen.tls_cert = folder + "/server.pem";
    listen.tls_key = folder + "/server.key";
    const std::string token = RandomSecret();
    TokenTable tokens;
    TESSERA_RETURN_IF_ERROR(tokens.Add({"fleet", Role::kWorker, Sha256Hex(token), 0}));
    for (const auto& [path, content] :
         {std::pair(folder + "/ca.pem", ca.certificate_pem), std::pair(listen.tls_cert, own.certificate_pem),
          std::pair(listen.tls_key, own.key_pem), std::pair(folder + "/tokens", tokens.ToText()),
          std::pair(folder + "/worker.token", token + "\n")}) {
      TESSERA_RETURN_IF_ERROR(WriteSecretFile(path, content));
    }
    TESSERA_ASSIGN_OR_RETURN(access_, Access::Open(RandomSecret(), folder + "/tokens", &clock_));
    return absl::OkStatus();
  }

  SystemClock clock_;
  std::unique_ptr<Access> access_;
  std::unique_ptr<StateStore> store_;
  std::unique_ptr<FolderBlobs> blobs_;
  std::unique_ptr<Coordinator> coordinator_;
  std::unique_ptr<CoordinatorServer> server_;
};

}  // namespace tessera
