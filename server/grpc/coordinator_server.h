// The coordinator on the network: the services of tessera.v1, health and, where it is asked for, reflection.
#ifndef TESSERA_SERVER_GRPC_COORDINATOR_SERVER_H_
#define TESSERA_SERVER_GRPC_COORDINATOR_SERVER_H_

#include <memory>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/storage/blob_store.h"
#include "server/admission/scene_files.h"
#include "server/auth/access.h"
#include "server/auth/client_limits.h"
#include "server/jobs/coordinator.h"
#include "server/metrics/rpc_counts.h"
#include "server/store/record_store.h"

namespace tessera {

// What the services stand on; all of it must outlive the server.
struct ServerEnvironment {
  Coordinator* coordinator = nullptr;
  BlobStore* blobs = nullptr;
  DigestCache* digests = nullptr;
  const Clock* clock = nullptr;
  const Access* access = nullptr;  // null: one of the server's own, which asks nobody who he is
  SceneLister list_scene;
  AllowedFiles scene_files = AllowedFiles::All();  // that scenes may have
  // False: whoever submits has to come through a socket, for nobody said which files others may have read.
  bool scenes_over_network = true;
  // Empty: workers move all data through the blob service.
  std::string shared_probe_path;
  std::string shared_probe_content;
  ClientLimitOptions limits = {};
};

struct ListenOptions {
  // HOST:PORT (port 0: any) or unix:PATH, which whoever may open the socket has to himself: without tokens.
  std::vector<std::string> addresses;
  // Files. A certificate and its key: TLS on every HOST:PORT. `tls_ca`: callers need a certificate of its too.
  std::string tls_cert, tls_key, tls_ca;
  bool reflection = false;  // tells readers of jobs which calls there are (grpc.reflection)
  bool insecure = false;    // a HOST:PORT beyond this machine may be listened on without TLS, tokens or both
  // HOST:PORT of the metrics, which nobody is asked for who he is; empty: none. Beyond this machine only if
  // `open_metrics`.
  std::string metrics;
  bool open_metrics = false;
};

// INVALID_ARGUMENT, with what to do, if the options do not fit together.
Status CheckListenOptions(const ListenOptions& options, bool asks_for_tokens);

class CoordinatorServer {
 public:
  // UNAVAILABLE if that cannot be listened on, errors of CheckListenOptions and of the files.
  static StatusOr<std::unique_ptr<CoordinatorServer>> Start(const ListenOptions& options,
                                                            const ServerEnvironment& environment);
  // On one address, without TLS.
  static StatusOr<std::unique_ptr<CoordinatorServer>> Start(const std::string& address,
                                                            const ServerEnvironment& environment);
  ~CoordinatorServer();
  // The first, with the port that was bound.
  const std::string& address() const;
  const std::vector<std::string>& addresses() const;
  // Of all calls since the start.
  const RpcCounts& rpc_counts() const;
  // Has the health service say NOT_SERVING while the coordinator cannot store anything or drains, and SERVING else;
  // breaks off transfers that are silent. To be called about once a second.
  void Tick();
  // Takes no jobs and leases nothing from now on, and says NOT_SERVING; all else goes on.
  void Drain();
  // Calls that move data or read a scene are under way.
  bool IsBusy() const;
  // Takes no new calls, ends waiting ones, lets running ones finish for `grace_s`. The coordinator is stopped, and not
  // needed any more then.
  void Shutdown(double grace_s);

 private:
  struct Impl;
  explicit CoordinatorServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_GRPC_COORDINATOR_SERVER_H_
