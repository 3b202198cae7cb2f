// `tessera cancel`: stops a job.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/connection.h"
#include "server/client/job_words.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

struct CancelFlags {
  Endpoint coordinator;
  std::string job;
};

int Cancel(const CancelFlags& flags) {
  const auto connection = Connection::Open(flags.coordinator);
  if (!connection.ok()) return Complain("cancel", connection.status());
  v1::Job job;
  const Status status = (*connection)->CancelJob(FullJobName(flags.job), &job);
  if (!status.ok()) return Complain("cancel", status);
  std::printf("%s %s\n", job.name().c_str(), JobStateWord(job.state()).c_str());
  return kExitOk;
}

}  // namespace

void AddCancelCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<CancelFlags>();
  CLI::App* command = app.add_subcommand("cancel", "Stop a job; one that has ended stays as it is");
  command->footer(
      "What its tasks have made is kept: the same job submitted again goes on from there.\n"
      "Example: tessera cancel jobs/7");
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "The job's name or number")->required();
  command->callback([flags, exit_code] { *exit_code = Cancel(*flags); });
}

}  // namespace tessera
