// tesserad: the coordinator.
#include <pthread.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "common/access/secrets.h"
#include "common/base/clock.h"
#include "common/rpc/channel.h"
#include "common/storage/files.h"
#include "server/grpc/coordinator_server.h"
#include "server/jobs/coordinator.h"
#include "server/ledger/record_owner.h"
#include "server/metrics/metrics_server.h"
#include "server/retention/retention_loop.h"
#include "server/store/sqlite_store.h"
#include "server/tesserad/logging.h"
#include "server/tesserad/maintenance.h"
#include "server/tesserad/open_blobs.h"

namespace tessera {
namespace {

constexpr double kShutdownGrace_s = 1;  // for short calls that still run

struct Flags {
  std::string data;
  ListenOptions listen;
  std::string port_file, token_file;
  std::vector<std::string> scene_roots;
  double lease_s = DispatchOptions().lease_s, stall_s = DispatchOptions().stall_s;
  double keep_days = 0, blob_gib = 0;
  double drain_s = 5;
  JobLimits jobs;
  WorkerLimits workers;
  ClientLimitOptions limits;
  double upload_gib = static_cast<double>(ClientLimitOptions().upload_bytes) / (int64_t{1} << 30);
  std::string backup;
  bool verify_state = false, deep = false, salvage = false;
  bool no_shared_storage = false;
  BlobFlags blobs;
  std::string log_level = "info";
  bool json_logs = false;
  bool exit_with_parent = false;
};

// Ends the process when its parent ends, also if that has happened already.
Status FollowParent() {
  const pid_t parent = ::getppid();
  if (::prctl(PR_SET_PDEATHSIG, SIGTERM) != 0) return absl::InternalError("cannot watch the parent process");
  if (::getppid() != parent || parent == 1) return absl::CancelledError("the parent process has ended");
  return absl::OkStatus();
}

// Raises the limit of open files to its maximum: each connection is an open file, and the usual limit is 1024.
void RaiseOpenFileLimit() {
  rlimit limit = {};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &limit);
}

// Warns about addresses that accept calls without a token.
void WarnOfOpenAddresses(const CoordinatorServer& server, const Access& access) {
  if (access.asks_for_tokens()) return;
  for (const std::string& address : server.addresses()) {
    if (IsSocketAddress(address)) continue;
    LogEvent(LogLevel::kWarning,
             IsLocalAddress(address) ? "no --token-file: every local user has all rights"
                                     : "--insecure: every caller that reaches this address has all rights",
             {{"address", address}});
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

// Serves until one of `stop_signals` arrives.
Status Serve(const Flags& flags, const sigset_t& stop_signals) {
  if (flags.data.empty())
    return absl::InvalidArgumentError("found neither --data nor a home folder, expected --data FOLDER");
  const std::string data = AbsolutePath(flags.data);
  ListenOptions listen = flags.listen;
  if (listen.addresses.empty()) listen.addresses = {"unix:" + data + "/socket"};
  TESSERA_RETURN_IF_ERROR(CheckListenOptions(listen, !flags.token_file.empty()));
  TESSERA_RETURN_IF_ERROR(EnsurePrivateFolder(data));
  const auto lock = FileLock::Acquire(data + "/lock");
  if (!lock.ok()) {
    return Status(lock.status().code(), "cannot lock " + data + ", probably used by another coordinator: " +
                                            std::string(lock.status().message()));
  }
  SystemClock clock;
  TESSERA_ASSIGN_OR_RETURN(const std::string worker_key, EnsureSecretFile(data + "/worker.key"));
  TESSERA_ASSIGN_OR_RETURN(const auto access, Access::Open(worker_key, flags.token_file, &clock));
  AllowedFiles scene_files = AllowedFiles::OwnedBy(::geteuid());
  if (!flags.scene_roots.empty()) {
    TESSERA_ASSIGN_OR_RETURN(scene_files, AllowedFiles::Under(flags.scene_roots));
  }
  TESSERA_ASSIGN_OR_RETURN(const auto store, SqliteStore::Open(data + "/state.sqlite", OwnerOfRecord));
  RetentionOptions keeping;
  keeping.keep_s = flags.keep_days * 86400;
  keeping.collector.keep_quarantined_s = keeping.keep_s;
  keeping.collector.limit_bytes = static_cast<int64_t>(flags.blob_gib * (int64_t{1} << 30));
  keeping.collector.grace_s = std::max(keeping.collector.grace_s, 2 * flags.lease_s);
  TESSERA_ASSIGN_OR_RETURN(OpenedBlobs opened, OpenBlobs(flags.blobs, data, keeping.collector.grace_s, &clock));
  TESSERA_RETURN_IF_ERROR(OpenTransfers(opened, data));
  BlobStore* const blobs = opened.store.get();
  Planner planner;
  DispatchOptions options;
  options.lease_s = flags.lease_s;
  options.max_check_gap_s = flags.lease_s / 2;  // at least two ticks
  options.stall_s = flags.stall_s;
  options.limits = flags.jobs;
  options.worker_limits = flags.workers;
  options.forget_worker_s = std::max(options.forget_worker_s, 3 * flags.lease_s);
  TESSERA_ASSIGN_OR_RETURN(const auto coordinator,
                           Coordinator::Open({store.get(), blobs, &planner, &clock, LogRecord,
                                              LogRecordQuarantined, LogJournalStatus, LogWorkerSuspended},
                                             options));

  ServerEnvironment environment;
  environment.coordinator = coordinator.get();
  environment.blobs = blobs;
  environment.transfers = opened.transfers.get();
  environment.digests = store.get();
  environment.clock = &clock;
  environment.access = access.get();
  environment.scene_files = scene_files;
  environment.scenes_over_network = !flags.scene_roots.empty();
  environment.limits = flags.limits;
  environment.limits.upload_bytes = static_cast<int64_t>(flags.upload_gib * (int64_t{1} << 30));
  if (!flags.no_shared_storage && !opened.folder.empty()) {
    environment.shared_blob_dir = opened.folder;
    environment.shared_probe_path = opened.folder + "/probe";
    environment.shared_probe_content = RandomSecret();  // identifies this folder
    TESSERA_RETURN_IF_ERROR(WriteFileAtomic(environment.shared_probe_path, environment.shared_probe_content));
  }
  TESSERA_ASSIGN_OR_RETURN(const auto server, CoordinatorServer::Start(listen, environment));
  std::unique_ptr<MetricsServer> metrics;
  if (!flags.listen.metrics.empty()) {
    TESSERA_ASSIGN_OR_RETURN(
        metrics,
        MetricsServer::Start(flags.listen.metrics, {[&] { return SnapshotOf(coordinator->core()); },
                                                    [&] { return blobs->FreeSpace(); }, &server->rpc_counts(),
                                                    opened.counts}));
    std::cout << "metrics: http://" << metrics->address() << "/metrics" << std::endl;
  }
  if (!flags.port_file.empty()) TESSERA_RETURN_IF_ERROR(WriteFileAtomic(flags.port_file, server->address() + "\n"));
  for (const std::string& address : server->addresses()) std::cout << "tesserad listens on " << address << std::endl;
  WarnOfOpenAddresses(*server, *access);
  LogEvent(LogLevel::kInfo, "coordinator started",
           {{"address", server->address()}, {"data", data}, {"start", std::to_string(store->StartCount())}});

  const RetentionLoop retention(coordinator->core(), blobs, &clock, keeping);

  const double tick_s = std::clamp(flags.lease_s / 4, 0.05, 1.0);
  const timespec tick = {static_cast<time_t>(tick_s), static_cast<long>((tick_s - static_cast<time_t>(tick_s)) * 1e9)};
  std::string last_error, last_refreshed = absl::OkStatus().ToString();
  while (::sigtimedwait(&stop_signals, nullptr, &tick) < 0) {
    if (const Status refreshed = access->Refresh(); refreshed.ToString() != last_refreshed) {
      last_refreshed = refreshed.ToString();
      if (!refreshed.ok()) {
        LogEvent(LogLevel::kError, "token file not read: the earlier tokens stay valid", {{"error", last_refreshed}});
      }
    }
    const Status status = coordinator->Tick();
    const std::string error = status.ok() ? "" : status.ToString();
    // Log each error once, not at every tick.
    if (!error.empty() && error != last_error) LogEvent(LogLevel::kError, "planning failed", {{"error", error}});
    last_error = error;
    server->Tick();
  }
  server->Drain();
  LogEvent(LogLevel::kInfo, "coordinator drains", {{"seconds", std::to_string(flags.drain_s)}});
  AwaitIdle(*server, flags.drain_s, stop_signals);
  LogEvent(LogLevel::kInfo, "coordinator stops");
  server->Shutdown(kShutdownGrace_s);
  return absl::OkStatus();
}

// Prints the error, if any, and returns the exit code.
int ReportExit(const Status& status) {
  if (status.ok()) return 0;
  std::cerr << "tesserad: " << status.message() << "\n";
  return status.code() == absl::StatusCode::kInvalidArgument ? 2 : 1;
}

// Options of the limits. A client is the name of a token or, without tokens, an address.
void AddLimits(CLI::App& app, Flags& flags) {
  const auto limit = [&](const std::string& name, auto& value, const std::string& help) {
    app.add_option(name, value, help)->check(CLI::Range(1, 100'000'000))->capture_default_str()->group("Limits");
  };
  limit("--max-jobs-of-client", flags.jobs.of_client,
        "Limit of unfinished jobs per client (a token or, without tokens, an address)");
  limit("--max-jobs", flags.jobs.in_all, "Limit of unfinished jobs of all clients");
  limit("--max-kept-jobs", flags.jobs.kept, "Limit of jobs that are not deleted, including ended ones");
  limit("--max-workers-of-client", flags.workers.of_client, "Limit of registered workers per client");
  limit("--max-workers", flags.workers.in_all, "Limit of registered workers of all clients");
  limit("--max-watches", flags.limits.watches, "Limit of open watches per client");
  limit("--max-transfers", flags.limits.transfers,
        "Limit of concurrent calls that transfer results or read a scene, per client and per worker");
  limit("--max-all-transfers", flags.limits.all_transfers, "Limit of such calls of all clients; each uses a thread");
  limit("--max-uploads", flags.limits.uploads, "Limit of unfinished uploads per client");
  app.add_option("--max-upload-gib", flags.upload_gib, "Limit of the total size of unfinished uploads per client, GiB")
      ->check(CLI::Range(0.0, 1e9))
      ->capture_default_str()
      ->group("Limits");
  app.add_option("--max-silence-s", flags.limits.silence_s, "Abort a transfer without progress for this time, seconds")
      ->check(CLI::Range(1.0, 1e6))
      ->capture_default_str()
      ->group("Limits");
}

// Options of the store of results. The credentials are never options: other users see the command line.
void AddBlobFlags(CLI::App& app, BlobFlags& blobs) {
  app.add_option("--blobs", blobs.url,
                 "Keep the results in this bucket of an S3 store in place of DATA/blobs; workers and clients get signed "
                 "URLs. Credentials: AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, AWS's files with AWS_PROFILE, or its "
                 "container endpoint")
      ->type_name("s3://BUCKET/PREFIX");
  app.add_option("--s3-endpoint", blobs.endpoint, "Address of the S3 store, which workers and clients must reach, too")
      ->type_name("URL");
  app.add_option("--s3-region", blobs.region, "Region that requests to the S3 store are signed for")
      ->capture_default_str();
  app.add_option("--s3-ca", blobs.ca_file, "Certificate authorities of the S3 store, PEM")->type_name("FILE");
}

int Main(int argc, char** argv) {
  Flags flags;
  flags.data = DefaultDataFolder();
  CLI::App app("Run the coordinator of Tessera", "tesserad");
  app.footer(
      "The coordinator accepts jobs, plans tiles and leases tasks to workers.\n"
      "Examples:\n"
      "  tesserad --data /srv/tessera\n"
      "  tesserad --listen 0.0.0.0:7575 --tls-cert keys/server.pem --tls-key keys/server.key --token-file keys/tokens "
      "\\\n"
      "           --scene-root /srv/cities\n"
      "  tesserad --data /srv/tessera --backup state.backup");
  app.set_version_flag("--version", TESSERA_VERSION);
  app.add_option("--data", flags.data, "Folder for state and results")->capture_default_str();
  app.add_option(
      "--listen", flags.listen.addresses,
      "Addresses to listen on: HOST:PORT (port 0: any free port) or unix:PATH, whose users need no token (default "
      "unix:DATA/socket, for this user only)");
  app.add_option("--tls-cert", flags.listen.tls_cert, "Certificate for every HOST:PORT, PEM")->type_name("FILE");
  app.add_option("--tls-key", flags.listen.tls_key, "Key of the certificate, PEM")->type_name("FILE");
  app.add_option("--tls-ca", flags.listen.tls_ca,
                 "Certificate authority, PEM: callers need one of its certificates as well as a token")
      ->type_name("FILE");
  app.add_option("--token-file", flags.token_file,
                 "Roles of the callers by token hash (`tessera access token` writes it); read again when it changes")
      ->type_name("FILE");
  app.add_flag("--insecure", flags.listen.insecure,
               "Allow network addresses without TLS or tokens: every caller that reaches them has all rights");
  app.add_option(
         "--scene-root", flags.scene_roots,
         "Folders whose scenes may be read; links may lead only into these folders. Without it, only jobs submitted "
         "through a Unix socket, with files owned by this user")
      ->type_name("FOLDER");
  app.add_option("--port-file", flags.port_file, "Write the bound HOST:PORT to this file");
  app.add_option("--metrics-listen", flags.listen.metrics,
                 "Serve Prometheus metrics at http://HOST:PORT/metrics, without authentication; network addresses need "
                 "--open-metrics");
  app.add_flag("--open-metrics", flags.listen.open_metrics, "Allow a network address for --metrics-listen");
  app.add_option("--lease-s", flags.lease_s,
                 "Return a task to the queue if its worker sends no heartbeat for this time, seconds")
      ->check(CLI::Range(0.2, 86400.0))
      ->capture_default_str();
  app.add_option(
         "--stall-s", flags.stall_s,
         "End an attempt without progress for this time, seconds, or ten times its predicted duration, if longer")
      ->check(CLI::Range(0.2, 1e9))
      ->capture_default_str();
  app.add_option(
         "--keep-days", flags.keep_days,
         "Delete ended jobs and quarantined blobs after this many days; the base of another job is kept; 0: never")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  app.add_option("--blob-gib", flags.blob_gib,
                 "Limit of stored results, GiB: remove quarantined blobs, then results of ended jobs that can be "
                 "recomputed; 0: no "
                 "limit")
      ->check(CLI::Range(0.0, 1e9))
      ->capture_default_str();
  app.add_option(
         "--drain-s", flags.drain_s,
         "Drain time after SIGTERM or SIGINT, seconds: refuse jobs and leases, report NOT_SERVING, and wait for "
         "calls that transfer data or read a scene; a second signal stops at once")
      ->check(CLI::Range(0.0, 86400.0))
      ->capture_default_str();
  app.add_flag("--reflection", flags.listen.reflection,
               "Serve gRPC reflection (for grpcurl) to callers that may read jobs");
  AddBlobFlags(app, flags.blobs);
  AddLimits(app, flags);
  const auto instead = [&](CLI::Option* option) { return option->group("Maintenance (instead of serving)"); };
  instead(
      app.add_option("--backup", flags.backup, "Copy the state of the data folder, which may be in use, to this file"));
  CLI::Option* const verify = instead(app.add_flag(
      "--verify-state", flags.verify_state, "Check the data folder and list its faults; exit code 1 if there are any"));
  instead(app.add_flag("--deep", flags.deep, "With --verify-state: read and hash all results"))->needs(verify);
  instead(app.add_flag("--salvage", flags.salvage,
                       "Recover the readable records of a damaged state; the damaged file is kept under another name"));
  app.add_flag("--no-shared-storage", flags.no_shared_storage,
               "Transfer all data of workers through the blob service; otherwise workers of this user read and write "
               "DATA/blobs directly and must be trusted");
  app.add_option("--log-level", flags.log_level, "Smallest level to log: debug, info, warn, error or off")
      ->capture_default_str();
  app.add_flag("--json-logs", flags.json_logs, "Log one JSON object per line");
  app.add_flag("--exit-with-parent", flags.exit_with_parent, "Stop when the parent process ends");
  CLI11_PARSE(app, argc, argv);
  ::umask(S_IRWXG | S_IRWXO);
  DisableCoreDumps();
  RaiseOpenFileLimit();

  if (const Status status = SetUpLog(flags.log_level, flags.json_logs); !status.ok()) {
    std::cerr << "tesserad: " << status.message() << "\n";
    return 2;
  }
  Status status;
  if (!flags.backup.empty() || flags.verify_state || flags.salvage) {
    const std::string data = AbsolutePath(flags.data);
    if (!flags.backup.empty()) status = BackUpData(data, flags.backup);
    if (status.ok() && flags.salvage) status = SalvageData(data);
    if (status.ok() && flags.verify_state) status = VerifyData(data, flags.blobs, flags.deep);
    return ReportExit(status);
  }
  // Block the signals in every thread; Serve waits for them.
  sigset_t stop_signals;
  sigemptyset(&stop_signals);
  sigaddset(&stop_signals, SIGTERM);
  sigaddset(&stop_signals, SIGINT);
  pthread_sigmask(SIG_BLOCK, &stop_signals, nullptr);
  ::signal(SIGPIPE, SIG_IGN);
  status = flags.exit_with_parent ? FollowParent() : absl::OkStatus();
  if (status.ok()) status = Serve(flags, stop_signals);
  return ReportExit(status);
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) { return tessera::Main(argc, argv); }
