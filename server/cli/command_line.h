// Options, requests, actions and error reports that commands share.
#pragma once

#include <cstdio>
#include <functional>
#include <string>

#include "common/base/message_list.h"
#include "common/base/printable.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/rpc/channel.h"
#include "server/settings/job_settings.h"

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace google::protobuf {
class Message;
}

namespace tessera {

namespace v1 {
class CreateJobRequest;
class Job;
class WatchJobResponse;
}  // namespace v1

class Connection;
class LocalCluster;
struct LocalClusterOptions;

// Adds --coordinator, --tls-ca, --tls-cert, --tls-key and --token-file. Each falls back to its environment variable
// (TESSERA_COORDINATOR, ...). Without either, the address is the socket of the user's own coordinator.
void AddCoordinatorOption(CLI::App& command, Endpoint* endpoint);
// Adds the same options without --coordinator.
void AddTlsOptions(CLI::App& command, Endpoint* endpoint);

// Adds a job's priority as the option or argument `name`.
CLI::Option* AddPriorityOption(CLI::App& command, const std::string& name, int* priority);

// A job as given on the command line: the scene, --tiles, --rounds, --method and its settings.
struct JobFlags {
  std::string scene;
  JobSettings settings;
  std::string epochs = "newest";
  double max_price = 0, price_per_core_hour = 0;
};
// Settings outside their limits are a parse error that names the found and the expected value.
void AddJobOptions(CLI::App& command, JobFlags* flags);
// Adds --tiles and --tile-memory.
void AddTileOptions(CLI::App& command, JobSettings* settings);
// Adds --skip-images and --anyway.
void AddSceneOptions(CLI::App& command, double* skip_images, bool* anyway);
// Adds the options of an update: --base, --withdraw, --epochs, --from-scratch. `base_values` describes what --base
// accepts.
void AddUpdateOptions(CLI::App& command, const std::string& base_values, JobFlags* flags);
// Adds the options of exports: --formats, --export-crs, --color, --export-gsd, --materials.
void AddExportOptions(CLI::App& command, ExportSettings* settings);
// Adds --max-price and --price-per-core-hour.
void AddPriceLimit(CLI::App& command, JobFlags* flags);

// The request for these flags; its scene is an absolute path or a URL.
v1::CreateJobRequest MakeRequest(const JobFlags& flags);
// INVALID_ARGUMENT if the request's scene is a folder that does not exist on this machine.
Status CheckSceneExists(const v1::CreateJobRequest& request);

// The message as JSON with all its fields.
StatusOr<std::string> ProtoJson(const google::protobuf::Message& message, bool indented);

// Replaces the file atomically. The error is INTERNAL, because it is none of the input.
Status WriteOutput(const std::string& path, const std::string& content);

// Makes `command` call `run` and store its exit code. An error of `run` is printed (ReportError).
void SetAction(CLI::App* command, int* exit_code, std::function<StatusOr<int>()> run);

// Starts a cluster on this machine, calls `use` with a connection to it, and stops it. The first interrupt aborts the
// start, the second the orderly stop.
Status WithLocalCluster(const LocalClusterOptions& options,
                        const std::function<Status(LocalCluster&, Connection&)>& use);

// Watches a job of a coordinator until it has ended, and returns its exit code: as of `tessera run`, also kExitPartial
// if the result fits the images worse than the start. Calls `show` with each change.
StatusOr<int> WatchJob(Connection& connection, const std::string& job,
                       const std::function<void(const v1::WatchJobResponse&)>& show);
// Shows progress on standard error.
StatusOr<int> WatchJobWithProgress(Connection& connection, const std::string& job);

// Prints "warning: ..." on standard error for each, shortened (ShortenMessages). An error is printed before.
template <class Warnings>
void PrintWarnings(const Warnings& warnings) {
  for (const std::string& warning : ShortenMessages({warnings.begin(), warnings.end()})) {
    std::fprintf(stderr, "warning: %s\n", PrintableLines(warning).c_str());
  }
}

// Writes report.html for the result of `job` in `out` (WriteReportPage). Returns its path; empty, with a warning on
// standard error, if it cannot be written: the result is complete without it.
std::string WritePageOrWarn(const v1::Job& job, const std::string& out, const TaskControl& control = {});

// Prints the error on standard error, with its line breaks, and returns its exit code.
int ReportError(const std::string& command, const Status& status);

// Exit code of a job that has ended. If it did not succeed, prints its error on standard error. `bad_input`: the job
// failed because its input is wrong.
int ExitCodeOfJob(const v1::Job& job, bool bad_input);

}  // namespace tessera
