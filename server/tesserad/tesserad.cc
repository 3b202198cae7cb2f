// tesserad: the coordinator.
#include <pthread.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <string>

#include "common/access/secrets.h"
#include "common/log/log.h"
#include "common/rpc/channel.h"
#include "common/storage/files.h"
#include "server/store/state_store.h"
#include "server/tesserad/maintenance.h"
#include "server/tesserad/serve.h"

namespace tessera {
namespace {

struct Flags : ServeOptions {
  std::string backup, copy_state;
  bool verify_state = false, deep = false, salvage = false;
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
                 "Folder for results (default DATA/blobs), or a bucket of an S3 store, s3://BUCKET/PREFIX: workers and "
                 "clients then get signed URLs. Credentials: AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, AWS's files "
                 "with AWS_PROFILE, or its container endpoint")
      ->type_name("FOLDER|URL");
  app.add_option("--s3-endpoint", blobs.endpoint, "Address of the S3 store, which workers and clients must reach, too")
      ->envname("AWS_ENDPOINT_URL")
      ->type_name("URL");
  app.add_option("--s3-region", blobs.region, "Region that requests to the S3 store are signed for")
      ->envname("AWS_REGION")
      ->capture_default_str();
  app.add_option("--s3-ca", blobs.ca_file, "Certificate authorities of the S3 store, PEM")
      ->envname("AWS_CA_BUNDLE")
      ->type_name("FILE");
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
      "  tesserad --data /srv/tessera --http 127.0.0.1:8080   (then open http://127.0.0.1:8080/)\n"
      "  tesserad --data /srv/tessera --backup state.backup\n"
      "  tesserad --data /var/tessera --state postgresql://db/tessera --blobs /shared/blobs --scene-root "
      "/shared/cities "
      "\\\n"
      "           --listen ...   (on two hosts: the second one stands by)\n"
      "A coordinator that another one has replaced ends with exit code 75: start it again, and it stands by.");
  app.set_version_flag("--version", TESSERA_VERSION);
  app.add_option("--data", flags.data, "Folder for state and results")->capture_default_str();
  app.add_option("--state", flags.state,
                 "Database for the state, as libpq reads it: postgresql://HOST/DATABASE. Several coordinators may be "
                 "started with one database: one serves, the others stand by and take over when it ends or is cut off. "
                 "They need the same --blobs and --scene-root, and a --data of their own. Default: DATA/state.sqlite, "
                 "for one coordinator, also on a shared folder")
      ->type_name("URL");
  AddBlobFlags(app, flags.blobs);
  app.add_flag("--accept-blobs", flags.accept_blobs,
               "With --state: use --blobs although it is not the store that the state was used with; results that it "
               "lacks are recomputed");
  app.add_option(
      "--listen", flags.listen.addresses,
      "Addresses to listen on: HOST:PORT (port 0: any free port) or unix:PATH, whose users need no token (default "
      "unix:DATA/socket, for this user only)");
  app.add_option(
         "--http", flags.listen.http,
         "Serve the page, and the API beneath it, at http://HOST:PORT/ (port 0: any free port), or https:// with "
         "--tls-cert; log in with a token. Network addresses need --tls-cert, --tls-key and --token-file, as "
         "those of --listen")
      ->type_name("HOST:PORT");
  app.add_option("--tls-cert", flags.listen.tls_cert, "Certificate for every HOST:PORT of --listen and --http, PEM")
      ->type_name("FILE");
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
         "Folders whose scenes may be read, where links may lead only into these folders, and places in an S3 store, "
         "s3://BUCKET/PREFIX, for scenes that tessera upload has sent. Without a folder, only jobs submitted through a "
         "Unix socket, with files owned by this user")
      ->type_name("FOLDER|URL");
  app.add_option("--port-file", flags.port_file,
                 "Write the bound HOST:PORT to this file, with --http the page's URL as second line");
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
         "calls that transfer data or read a scene; a second signal stops at once (default 5, or 1 with --state, where "
         "a standby takes over)")
      ->check(CLI::Range(0.0, 86400.0));
  app.add_flag("--reflection", flags.listen.reflection,
               "Serve gRPC reflection (for grpcurl) to callers that may read jobs");
  AddLimits(app, flags);
  const auto instead = [&](CLI::Option* option) { return option->group("Maintenance (instead of serving)"); };
  instead(
      app.add_option("--backup", flags.backup, "Copy the state of the data folder, which may be in use, to this file"));
  CLI::Option* const verify = instead(app.add_flag(
      "--verify-state", flags.verify_state, "Check the state and list its faults; exit code 1 if there are any"));
  instead(app.add_flag("--deep", flags.deep, "With --verify-state: read and hash all results"))->needs(verify);
  instead(app.add_flag("--salvage", flags.salvage,
                       "Recover the readable records of a damaged state; the damaged file is kept under another name"));
  instead(app.add_option("--copy-state", flags.copy_state,
                         "Copy the state of a stopped coordinator to another database: a file or postgresql://..., "
                         "which must be new or empty. Then start the coordinator with it (--state)"))
      ->type_name("TO");
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
  flags.version = TESSERA_VERSION;
  Status status;
  // The command line is in the list of processes.
  for (const std::string& url : {flags.state, flags.copy_state}) {
    if (!url.empty() && HasPassword(url)) {
      return ReportExit(absl::InvalidArgumentError(
          "found a password in the address of the database, which every local user can read in the list of processes; "
          "write it to a password file (~/.pgpass or PGPASSFILE) or a service file"));
    }
  }
  if (!flags.backup.empty() || flags.verify_state || flags.salvage || !flags.copy_state.empty()) {
    const std::string data = AbsolutePath(flags.data);
    if (!flags.backup.empty()) status = BackUpData(data, flags.state, flags.backup);
    if (status.ok() && flags.salvage) status = SalvageData(data, flags.state);
    if (status.ok() && flags.verify_state) status = VerifyData(data, flags.state, flags.blobs, flags.deep);
    if (status.ok() && !flags.copy_state.empty()) status = CopyStateTo(data, flags.state, flags.copy_state);
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
