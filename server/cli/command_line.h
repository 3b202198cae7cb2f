// What the job commands have in common on the command line.
#ifndef TESSERA_SERVER_CLI_COMMAND_LINE_H_
#define TESSERA_SERVER_CLI_COMMAND_LINE_H_

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

// --coordinator, --tls-ca, --tls-cert, --tls-key, --token-file, each or its variable of the environment
// (TESSERA_COORDINATOR, ...); else the socket of the user's own coordinator.
void AddCoordinatorOption(CLI::App& command, Endpoint* endpoint);
// All but --coordinator.
void AddTlsOptions(CLI::App& command, Endpoint* endpoint);

// A job's priority, as option or argument `name`.
CLI::Option* AddPriorityOption(CLI::App& command, const std::string& name, int* priority);

// What a user asks of a job: the scene, and the flags --tiles, --rounds, --method and its settings.
struct JobFlags {
  std::string scene;
  JobSettings settings;
  std::string epochs = "newest";
  double max_price = 0, price_per_core_hour = 0;
};
// Settings outside their limits end the parsing with what was found and what was expected.
void AddJobOptions(CLI::App& command, JobFlags* flags);
// The flags of a job that goes on from another: --base and what it is to do with it. `base_is`: what may be given.
void AddUpdateOptions(CLI::App& command, const std::string& base_is, JobFlags* flags);
// --max-price, --price-per-core-hour.
void AddPriceLimit(CLI::App& command, JobFlags* flags);

// The request for these flags, its scene made an absolute path. INVALID_ARGUMENT if there is no such folder.
Status MakeRequest(const JobFlags& flags, v1::CreateJobRequest* request);

// A request_id that nobody has used, so that a submission whose answer was lost can be sent again.
std::string NewRequestId();

// Prints "warning: ..." on standard error for each.
template <class Warnings>
void PrintWarnings(const Warnings& warnings) {
  for (const std::string& warning : warnings) std::fprintf(stderr, "warning: %s\n", PrintableLines(warning).c_str());
}

// Prints the error, line by line as it came, on standard error and gives the exit code for it.
int Complain(const std::string& command, const Status& status);

// Exit code of a job that has ended; says on standard error why it did not succeed. `bad_input`: whether it failed for
// a fault of the input.
int ExitCodeOfJob(const v1::Job& job, bool bad_input);

}  // namespace tessera

#endif  // TESSERA_SERVER_CLI_COMMAND_LINE_H_
