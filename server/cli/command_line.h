// Options, requests and error reports that the job commands share.
#pragma once

#include <cstdio>
#include <string>

#include "common/base/printable.h"
#include "common/base/status.h"
#include "common/rpc/channel.h"
#include "server/settings/job_settings.h"

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace tessera {

namespace v1 {
class CreateJobRequest;
class Job;
}  // namespace v1

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
// Adds the options of an update: --base, --withdraw, --epochs, --from-scratch. `base_values` describes what --base
// accepts.
void AddUpdateOptions(CLI::App& command, const std::string& base_values, JobFlags* flags);
// Adds --max-price and --price-per-core-hour.
void AddPriceLimit(CLI::App& command, JobFlags* flags);

// The request for these flags; its scene is an absolute path. INVALID_ARGUMENT if the path cannot be made absolute.
Status MakeRequest(const JobFlags& flags, v1::CreateJobRequest* request);

// A random request_id. It lets the client repeat a submission whose answer was lost.
std::string NewRequestId();

// Prints "warning: ..." on standard error for each.
template <class Warnings>
void PrintWarnings(const Warnings& warnings) {
  for (const std::string& warning : warnings) std::fprintf(stderr, "warning: %s\n", PrintableLines(warning).c_str());
}

// Prints the error on standard error, with its line breaks, and returns its exit code.
int ReportError(const std::string& command, const Status& status);

// Exit code of a job that has ended. If it did not succeed, prints its error on standard error. `bad_input`: the job
// failed because its input is wrong.
int ExitCodeOfJob(const v1::Job& job, bool bad_input);

}  // namespace tessera
