// `tessera cancel`: cancels a job.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/connection.h"
#include "server/client/job_text.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

struct CancelFlags {
  Endpoint coordinator;
  std::string job;
};

int Cancel(const CancelFlags& flags) {
  const auto connection = Connection::Open(flags.coordinator);
  if (!connection.ok()) return ReportError("cancel", connection.status());
  v1::Job job;
  const Status status = (*connection)->CancelJob(FullJobName(flags.job), &job);
  if (!status.ok()) return ReportError("cancel", status);
  std::printf("%s %s\n", job.name().c_str(), JobStateName(job.state()).c_str());
  return kExitOk;
}

}  // namespace

void AddCancelCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<CancelFlags>();
  CLI::App* command = app.add_subcommand("cancel", "Cancel a job");
  command->footer(
      "The results of finished tasks are kept: the same job, submitted again, reuses them. A job that has ended does "
      "not\n"
      "change.\n"
      "Example:\n"
      "  tessera cancel jobs/7");
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "The job's name or number")->required();
  command->callback([flags, exit_code] { *exit_code = Cancel(*flags); });
}

}  // namespace tessera
