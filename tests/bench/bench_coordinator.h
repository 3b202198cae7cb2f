// A coordinator in the bench's own process, on loopback.
#ifndef TESSERA_TESTS_BENCH_BENCH_COORDINATOR_H_
#define TESSERA_TESTS_BENCH_BENCH_COORDINATOR_H_

#include <memory>
#include <string>

#include "common/base/clock.h"
#include "common/storage/blob_store.h"
#include "common/storage/files.h"
#include "server/api/coordinator_server.h"
#include "server/dispatch/dispatcher.h"
#include "server/store/sqlite_store.h"

namespace tessera {

class BenchCoordinator {
 public:
  // State and blobs lie in `folder`. `planner` must outlive it. `shared_storage`: workers are told where blobs lie.
  static StatusOr<std::unique_ptr<BenchCoordinator>> Start(const std::string& folder, Planner* planner,
                                                           bool shared_storage) {
    std::unique_ptr<BenchCoordinator> started(new BenchCoordinator);
    TESSERA_ASSIGN_OR_RETURN(started->store_, SqliteStore::Open(folder + "/state.sqlite"));
    TESSERA_ASSIGN_OR_RETURN(started->blobs_, BlobStore::Open(folder + "/blobs"));
    TESSERA_ASSIGN_OR_RETURN(started->dispatcher_, Dispatcher::Open({started->store_.get(), started->blobs_.get(),
                                                                     planner, &started->clock_, /*on_change=*/{}},
                                                                    DispatchOptions()));
    ServerEnvironment environment;
    environment.dispatcher = started->dispatcher_.get();
    environment.blobs = started->blobs_.get();
    environment.digests = started->store_.get();
    environment.clock = &started->clock_;
    if (shared_storage) {
      environment.shared_probe_path = started->blobs_->root() + "/probe";
      environment.shared_probe_content = "probe";
      TESSERA_RETURN_IF_ERROR(WriteFileAtomic(environment.shared_probe_path, environment.shared_probe_content));
    }
    TESSERA_ASSIGN_OR_RETURN(started->server_, CoordinatorServer::Start("127.0.0.1:0", environment));
    return started;
  }

  Dispatcher& dispatcher() { return *dispatcher_; }
  BlobStore& blobs() { return *blobs_; }
  const std::string& address() const { return server_->address(); }

 private:
  BenchCoordinator() = default;

  SystemClock clock_;
  std::unique_ptr<SqliteStore> store_;
  std::unique_ptr<BlobStore> blobs_;
  std::unique_ptr<Dispatcher> dispatcher_;
  std::unique_ptr<CoordinatorServer> server_;
};

}  // namespace tessera

#endif  // TESSERA_TESTS_BENCH_BENCH_COORDINATOR_H_
