#include "server/tesserad/serve.h"

#include <unistd.h>

#include <algorithm>
#include <iostream>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "common/access/secrets.h"
#include "common/base/clock.h"
#include "common/log/log.h"
#include "common/rpc/channel.h"
#include "common/storage/files.h"
#include "server/http/http_server.h"
#include "server/http/routes.h"
#include "server/jobs/coordinator.h"
#include "server/metrics/metrics_server.h"
#include "server/retention/retention_loop.h"
#include "server/store/state_store.h"
#include "server/tesserad/logging.h"
#include "server/tesserad/notify.h"
#include "server/tesserad/standby.h"

namespace tessera {
namespace {

constexpr double kShutdownGrace_s = 1;  // for short calls that still run
constexpr double kDeleteMargin_s = 2;   // blobs are removed only while the right to write is held for longer

// Where things are.
struct Places {
  std::string data, state;
  ListenOptions listen;
};

StatusOr<Places> PlacesOf(const ServeOptions& options) {
  if (options.data.empty())
    return absl::InvalidArgumentError("found neither --data nor a home folder, expected --data FOLDER");
  Places places;
  places.data = AbsolutePath(options.data);
  if (!options.state.empty() && !IsPostgresUrl(options.state)) {
    return InputError("--state", "", "'" + options.state + "'",
                      "postgresql://HOST/DATABASE; without it, the state is DATA/state.sqlite, for one coordinator");
  }
  places.state = options.state.empty() ? places.data + "/state.sqlite" : options.state;
  places.listen = options.listen;
  if (places.listen.addresses.empty()) places.listen.addresses = {"unix:" + places.data + "/socket"};
  TESSERA_RETURN_IF_ERROR(CheckListenOptions(places.listen, !options.token_file.empty()));
  return places;
}

DispatchOptions DispatchOptionsOf(const ServeOptions& options) {
  DispatchOptions dispatch;
  dispatch.lease_s = options.lease_s;
  dispatch.max_check_gap_s = options.lease_s / 2;  // at least two ticks
  dispatch.stall_s = options.stall_s;
  dispatch.limits = options.jobs;
  dispatch.worker_limits = options.workers;
  dispatch.forget_worker_s = std::max(dispatch.forget_worker_s, 3 * options.lease_s);
  return dispatch;
}

RetentionOptions RetentionOptionsOf(const ServeOptions& options) {
  RetentionOptions keeping;
  keeping.keep_s = options.keep_days * 86400;
  keeping.collector.keep_quarantined_s = keeping.keep_s;
  keeping.collector.limit_bytes = static_cast<int64_t>(options.blob_gib * (int64_t{1} << 30));
  keeping.collector.grace_s = std::max(keeping.collector.grace_s, 2 * options.lease_s);
  return keeping;
}

// Warns about addresses that accept calls without a token.
void WarnOfOpenAddresses(const std::vector<std::string>& addresses, const Access& access) {
  if (access.asks_for_tokens()) return;
  for (const std::string& address : addresses) {
    if (IsSocketAddress(address)) continue;
    LogWarning(IsLocalAddress(address) ? "no --token-file: every local user has all rights"
                                       : "--insecure: every caller that reaches this address has all rights",
               {{"address", address}});
  }
}

// Lets workers that read the file `probe` read and write blobs in the folder directly.
Status ShareFolder(const std::string& folder, ServerEnvironment& environment) {
  environment.shared_blob_dir = folder;
  environment.shared_probe_path = folder + "/probe";
  environment.shared_probe_content = RandomSecret();  // identifies this folder
  return WriteFileAtomic(environment.shared_probe_path, environment.shared_probe_content);
}

// The metrics are those of a coordinator that serves, as long as this object lives.
class ServingMetrics {
 public:
  ServingMetrics(MetricsServer* server, MetricSources sources) : server_(server) {
    if (server_ != nullptr) server_->Replace(std::move(sources));
  }
  ~ServingMetrics() {
    if (server_ != nullptr) server_->Replace({});
  }

 private:
  MetricsServer* const server_;
};

std::vector<std::string> FoldersOf(std::vector<std::string> scene_roots) {
  std::erase_if(scene_roots, IsS3Url);
  return scene_roots;
}

// Requests to S3 stores, for blobs and scenes. Empty if there is no store.
std::function<std::map<std::string, S3Counts>()> CountsOf(const OpenedBlobs& blobs, const StoredScenes* scenes) {
  if (scenes == nullptr) return blobs.counts;
  return [of_blobs = blobs.counts, scenes] {
    std::map<std::string, S3Counts> counts = scenes->counts();
    if (of_blobs) AddCounts(of_blobs(), &counts);
    return counts;
  };
}

// Does what is due from time to time, until a signal arrives.
void TickUntil(const sigset_t& stop_signals, double tick_s, Coordinator& coordinator, CoordinatorServer& server,
               Access& access) {
  const timespec tick = {static_cast<time_t>(tick_s), static_cast<long>((tick_s - static_cast<time_t>(tick_s)) * 1e9)};
  std::string last_error, last_refreshed = absl::OkStatus().ToString();
  while (::sigtimedwait(&stop_signals, nullptr, &tick) < 0) {
    if (const Status refreshed = access.Refresh(); refreshed.ToString() != last_refreshed) {
      last_refreshed = refreshed.ToString();
      if (!refreshed.ok()) LogError("token file not read: the earlier tokens stay valid", {{"error", last_refreshed}});
    }
    const Status status = coordinator.TickInBackground();
    const std::string error = status.ok() ? "" : status.ToString();
    // Log each error once, not at every tick.
    if (!error.empty() && error != last_error) LogError("planning failed", {{"error", error}});
    last_error = error;
    server.Tick();
  }
}

// Waits up to `seconds` until no call transfers data or reads a scene. Another signal ends the process at once;
// acknowledged changes are durable.
void AwaitIdle(const CoordinatorServer& server, double seconds, const sigset_t& stop_signals) {
  const timespec poll = {0, 50'000'000};
  const SystemClock clock;
  const int64_t until_us = clock.MonotonicUs() + static_cast<int64_t>(seconds * 1e6);
  while (server.IsBusy() && clock.MonotonicUs() < until_us) {
    if (const int signal = ::sigtimedwait(&stop_signals, nullptr, &poll); signal > 0) ::_exit(128 + signal);
  }
}

// Replays the state, listens, and serves until a signal arrives and running calls have ended.
Status ServeState(const ServeOptions& options, const Places& places, const SharedStorage& storage, OpenedBlobs& opened,
                  const StoredScenes* scenes, StateStore& store, MetricsServer* metrics, const sigset_t& stop_signals) {
  const RightWatch right(store);
  SystemClock clock;
  BlobStore* const blobs = opened.store.get();
  TESSERA_RETURN_IF_ERROR(OpenTransfers(opened, places.data));
  RetentionOptions keeping = RetentionOptionsOf(options);
  if (IsPostgresUrl(places.state)) {
    TESSERA_ASSIGN_OR_RETURN(const Digest probe, MarkStorage(store, storage));
    keeping.collector.keep = {probe.sha256};
    keeping.may_remove_blobs = [&store] { return store.HeldFor_s() > kDeleteMargin_s; };
  }
  TESSERA_ASSIGN_OR_RETURN(const std::string worker_key, store.WorkerKey());
  TESSERA_ASSIGN_OR_RETURN(const auto access, Access::Open(worker_key, options.token_file, &clock));
  Planner planner;
  DispatchEnvironment dispatch{
      &store, blobs, &planner, &clock, LogRecord, LogRecordQuarantined, LogJournalStatus, LogWorkerSuspended};
  dispatch.on_taken_over = EndReplaced;
  dispatch.hash_scene_file = [scenes](const std::string& path) { return HashSceneFile(path, scenes); };
  TESSERA_ASSIGN_OR_RETURN(const auto coordinator, Coordinator::Open(dispatch, DispatchOptionsOf(options)));

  ServerEnvironment environment;
  environment.coordinator = coordinator.get();
  environment.blobs = blobs;
  environment.transfers = opened.transfers.get();
  environment.digests = &store;
  environment.clock = &clock;
  environment.access = access.get();
  const std::vector<std::string> folders = FoldersOf(storage.scene_roots);
  environment.scene_files = AllowedFiles::OwnedBy(::geteuid());
  if (!folders.empty()) {
    TESSERA_ASSIGN_OR_RETURN(environment.scene_files, AllowedFiles::Under(folders));
  }
  environment.scenes_over_network = !folders.empty();
  environment.stored_scenes = scenes;
  environment.limits = options.limits;
  environment.limits.upload_bytes = static_cast<int64_t>(options.upload_gib * (int64_t{1} << 30));
  environment.before_reply = [&right] { right.Check(); };
  if (!options.no_shared_storage && !opened.folder.empty()) {
    TESSERA_RETURN_IF_ERROR(ShareFolder(opened.folder, environment));
  }
  TESSERA_ASSIGN_OR_RETURN(const auto server, CoordinatorServer::Start(places.listen, environment));
  HttpCounts http_counts(HttpRouteNames());
  const ServingMetrics serving(metrics,
                               {[&] { return SnapshotOf(coordinator->core()); }, [&] { return blobs->FreeSpace(); },
                                &server->rpc_counts(), CountsOf(opened, scenes),
                                places.listen.http.empty() ? nullptr : &http_counts});
  std::unique_ptr<HttpServer> http;
  if (!places.listen.http.empty()) {
    const HttpOptions page = {
        places.listen.http, places.listen.insecure, options.version, environment.before_reply, {}, &http_counts};
    TESSERA_ASSIGN_OR_RETURN(http, HttpServer::Start(page, server.get()));
  }
  if (!options.port_file.empty()) {
    TESSERA_RETURN_IF_ERROR(WriteFileAtomic(
        options.port_file, absl::StrCat(server->address(), "\n", http == nullptr ? "" : http->url() + "\n")));
  }
  for (const std::string& address : server->addresses()) std::cout << "tesserad listens on " << address << std::endl;
  if (http != nullptr) std::cout << "page: " << http->url() << std::endl;
  std::vector<std::string> addresses = server->addresses();
  if (http != nullptr) addresses.push_back(http->address());
  WarnOfOpenAddresses(addresses, *access);
  LogFields started = {{"address", server->address()},
                       {"data", places.data},
                       {"state", store.Location()},
                       {"start", absl::StrCat(store.StartCount())}};
  if (http != nullptr) started.emplace_back("page", http->url());
  LogInfo("coordinator started", started);
  NotifyReady();
  {
    const RetentionLoop retention(coordinator->core(), blobs, &clock, keeping);
    TickUntil(stop_signals, std::clamp(options.lease_s / 4, 0.05, 1.0), *coordinator, *server, *access);
  }
  const double drain_s = options.drain_s.value_or(IsPostgresUrl(places.state) ? kHandOver_s : kDrain_s);
  server->Drain();
  LogInfo("coordinator drains", {{"seconds", absl::StrCat(drain_s)}});
  AwaitIdle(*server, drain_s, stop_signals);
  LogInfo("coordinator stops");
  http.reset();
  server->Shutdown(kShutdownGrace_s);
  return absl::OkStatus();
}

}  // namespace

Status Serve(const ServeOptions& options, const sigset_t& stop_signals) {
  TESSERA_ASSIGN_OR_RETURN(const Places places, PlacesOf(options));
  TESSERA_RETURN_IF_ERROR(EnsurePrivateFolder(places.data));
  std::optional<FileLock> lock;  // a file of SQLite's locks its folder itself
  if (IsPostgresUrl(places.state)) {
    auto locked = FileLock::Acquire(places.data + "/lock");
    if (!locked.ok()) {
      return Status(locked.status().code(), absl::StrCat("cannot lock ", places.data,
                                                         ", probably used by another "
                                                         "coordinator: ",
                                                         locked.status().message()));
    }
    lock = *std::move(locked);
  }
  const SystemClock clock;
  TESSERA_RETURN_IF_ERROR(Access::Open("", options.token_file, &clock).status());  // before anything is begun
  SharedStorage storage;
  for (const std::string& root : options.scene_roots) {
    storage.scene_roots.push_back(IsS3Url(root) ? std::string(absl::StripSuffix(root, "/")) : AbsolutePath(root));
  }
  TESSERA_RETURN_IF_ERROR(AllowedFiles::Under(FoldersOf(storage.scene_roots)).status());
  TESSERA_ASSIGN_OR_RETURN(const OpenedScenes scenes, OpenStoredScenes(storage.scene_roots, options.blobs, &clock));
  TESSERA_ASSIGN_OR_RETURN(
      OpenedBlobs blobs, OpenBlobs(options.blobs, places.data, RetentionOptionsOf(options).collector.grace_s, &clock));
  storage.blobs = blobs.store.get();
  storage.accept_blobs = options.accept_blobs;
  std::unique_ptr<MetricsServer> metrics;
  if (!places.listen.metrics.empty()) {
    TESSERA_ASSIGN_OR_RETURN(metrics, MetricsServer::Start(places.listen.metrics, {}));
    std::cout << "metrics: http://" << metrics->address() << "/metrics" << std::endl;
  }
  const auto stop = [&stop_signals] {
    const timespec now = {};
    return ::sigtimedwait(&stop_signals, nullptr, &now) > 0;
  };
  TESSERA_ASSIGN_OR_RETURN(const auto store, AwaitState(places.state, storage, stop));
  if (store == nullptr) return absl::OkStatus();
  const Status served =
      ServeState(options, places, storage, blobs, scenes.scenes.get(), *store, metrics.get(), stop_signals);
  store->Release();  // a standby takes over at once
  return served;
}

}  // namespace tessera
