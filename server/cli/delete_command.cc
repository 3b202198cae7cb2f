// `tessera delete`: forgets a job that has ended.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/connection.h"
#include "server/client/job_words.h"

namespace tessera {
namespace {

struct DeleteFlags {
  Endpoint coordinator;
  std::string job;
};

int Delete(const DeleteFlags& flags) {
  const auto connection = Connection::Open(flags.coordinator);
  if (!connection.ok()) return Complain("delete", connection.status());
  const std::string name = FullJobName(flags.job);
  const Status status = (*connection)->DeleteJob(name);
  if (!status.ok()) return Complain("delete", status);
  std::printf("%s deleted\n", name.c_str());
  return kExitOk;
}

}  // namespace

void AddDeleteCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<DeleteFlags>();
  CLI::App* command = app.add_subcommand("delete", "Forget a job that has ended");
  command->footer(
      "Its results go, but for those that other jobs have too; fetch them first. A job that another goes on from (an\n"
      "update, a rollback) stays until that is deleted.\n"
      "Example: tessera delete jobs/7");
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "The job's name or number")->required();
  command->callback([flags, exit_code] { *exit_code = Delete(*flags); });
}

}  // namespace tessera
