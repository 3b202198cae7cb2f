// `tessera delete`: deletes a job that has ended.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/connection.h"
#include "server/client/job_text.h"

namespace tessera {
namespace {

struct DeleteFlags {
  Endpoint coordinator;
  std::string job;
};

int Delete(const DeleteFlags& flags) {
  const auto connection = Connection::Open(flags.coordinator);
  if (!connection.ok()) return ReportError("delete", connection.status());
  const std::string name = FullJobName(flags.job);
  const Status status = (*connection)->DeleteJob(name);
  if (!status.ok()) return ReportError("delete", status);
  std::printf("%s deleted\n", name.c_str());
  return kExitOk;
}

}  // namespace

void AddDeleteCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<DeleteFlags>();
  CLI::App* command = app.add_subcommand("delete", "Delete a job that has ended");
  command->footer(
      "Results that no other job uses are removed; fetch them first. A base job (of an update or a rollback) cannot "
      "be\n"
      "deleted before the jobs that use it.\n"
      "Example:\n"
      "  tessera delete jobs/7");
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "The job's name or number")->required();
  command->callback([flags, exit_code] { *exit_code = Delete(*flags); });
}

}  // namespace tessera
