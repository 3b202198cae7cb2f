// The coordinator on the network: the services of tessera.v1, health and reflection on one address.
#ifndef TESSERA_SERVER_API_COORDINATOR_SERVER_H_
#define TESSERA_SERVER_API_COORDINATOR_SERVER_H_

#include <memory>
#include <string>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/storage/blob_store.h"
#include "server/api/scene_files.h"
#include "server/dispatch/dispatcher.h"
#include "server/metrics/rpc_counts.h"
#include "server/store/record_store.h"

namespace tessera {

// What the services stand on; all of it must outlive the server.
struct ServerEnvironment {
  Dispatcher* dispatcher = nullptr;
  BlobStore* blobs = nullptr;
  DigestCache* digests = nullptr;
  const Clock* clock = nullptr;
  SceneLister list_scene;
  // Empty: workers move all data through the blob service.
  std::string shared_probe_path;
  std::string shared_probe_content;
};

class CoordinatorServer {
 public:
  // Listens on `address` ("host:port"; port 0: any). UNAVAILABLE if that is not possible.
  static StatusOr<std::unique_ptr<CoordinatorServer>> Start(const std::string& address,
                                                            const ServerEnvironment& environment);
  ~CoordinatorServer();
  // With the port that was bound.
  const std::string& address() const;
  // Of all calls since the start.
  const RpcCounts& rpc_counts() const;
  // Has the health service say NOT_SERVING while the dispatcher cannot store anything, and SERVING else. To be called
  // about once a second.
  void UpdateHealth();
  // Takes no new calls, ends waiting ones, lets running ones finish for `grace_s`. The dispatcher is stopped.
  void Shutdown(double grace_s);

 private:
  struct Impl;
  explicit CoordinatorServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_API_COORDINATOR_SERVER_H_
