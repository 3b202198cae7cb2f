// The coordinator's gRPC server: the services of tessera.v1, health and, if enabled, reflection.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/s3_blobs/blob_transfers.h"
#include "common/storage/blob_store.h"
#include "server/admission/scene_reader.h"
#include "server/auth/access.h"
#include "server/auth/client_limits.h"
#include "server/jobs/coordinator.h"
#include "server/metrics/rpc_counts.h"
#include "server/store/record_store.h"

namespace tessera {

class JobWatches;
class LocalCalls;
class TlsCertificates;

// Dependencies of the services. All must outlive the server.
struct ServerEnvironment {
  Coordinator* coordinator = nullptr;
  BlobStore* blobs = nullptr;
  DigestCache* digests = nullptr;
  const Clock* clock = nullptr;
  const Access* access = nullptr;  // null: every caller has all rights
  SceneReader read_scene = ReadScene;
  AllowedFiles scene_files = AllowedFiles::All();  // files that scenes may have
  // False: only callers through a socket may submit scenes in folders.
  bool scenes_over_network = true;
  const StoredScenes* stored_scenes = nullptr;  // null: no scenes in an object store
  // Empty: workers transfer all data through the blob service. Else a worker that reads `shared_probe_content` at
  // `shared_probe_path` reads and stores blobs in the folder `shared_blob_dir`, which is that of `blobs`.
  std::string shared_probe_path;
  std::string shared_blob_dir;
  std::string shared_probe_content;
  // Signs the URLs with which callers read and write the blobs directly; null: all pass the blob service.
  const BlobTransfers* transfers = nullptr;
  ClientLimitOptions limits = {};
  // Called by the thread that answers before each message and status of a call leaves: a process that another
  // coordinator may have replaced ends here, because its answers may be old. Must be quick. May be empty.
  std::function<void()> before_reply = {};
};

struct ListenOptions {
  // HOST:PORT (port 0: any free port) or unix:PATH. Callers through a socket need no token.
  std::vector<std::string> addresses;
  // Files, PEM. Certificate and key enable TLS on every HOST:PORT. `tls_ca`: callers need a certificate of this
  // authority. Renewed when the files change (TlsCertificates).
  std::string tls_cert, tls_key, tls_ca;
  bool reflection = false;  // serve grpc.reflection to callers that may read jobs
  bool insecure = false;    // allow network addresses without TLS, tokens or both
  // HOST:PORT of the metrics, served without authentication; empty: none. A network address needs `open_metrics`.
  std::string metrics;
  bool open_metrics = false;
  std::string http;  // HOST:PORT of the page and its API (server/http); empty: none
};

// INVALID_ARGUMENT with advice if the options are inconsistent.
Status CheckListenOptions(const ListenOptions& options, bool asks_for_tokens);

class CoordinatorServer {
 public:
  // UNAVAILABLE if it cannot listen on an address; errors of CheckListenOptions and of the files.
  static StatusOr<std::unique_ptr<CoordinatorServer>> Start(const ListenOptions& options,
                                                            const ServerEnvironment& environment);
  // On one address, without TLS.
  static StatusOr<std::unique_ptr<CoordinatorServer>> Start(const std::string& address,
                                                            const ServerEnvironment& environment);
  ~CoordinatorServer();
  // The first address, with the bound port.
  const std::string& address() const;
  const std::vector<std::string>& addresses() const;
  // Calls of these services from inside the process; stops with Shutdown.
  LocalCalls& local_calls();
  // Those of WatchJob, for watches inside the process; they end with Shutdown.
  JobWatches& watches();
  // Null without TLS.
  std::shared_ptr<TlsCertificates> certificates() const;
  const Access& access() const;
  // Counts of all calls since the start.
  const RpcCounts& rpc_counts() const;
  // Updates the health service: NOT_SERVING while journal writes fail or the coordinator drains, else SERVING. Aborts
  // silent transfers. Call about once a second.
  void Tick();
  // From this call on, refuses jobs and leases and reports NOT_SERVING. Other calls continue.
  void Drain();
  // Whether calls that transfer data or read a scene are running.
  bool IsBusy() const;
  // Refuses new calls, ends waiting ones and gives running ones `grace_s` seconds. Stops the coordinator; the server
  // does not use it afterwards.
  void Shutdown(double grace_s);

 private:
  struct Impl;
  explicit CoordinatorServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
