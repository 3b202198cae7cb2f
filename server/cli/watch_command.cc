// `tessera watch`: follows a job.
#include <CLI/CLI.hpp>
#include <memory>

#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/cli/watching.h"
#include "server/client/connection.h"
#include "server/client/job_words.h"

namespace tessera {
namespace {

struct WatchFlags {
  Endpoint coordinator;
  std::string job;
  bool json = false;
};

int Watch(const WatchFlags& flags) {
  const auto connection = Connection::Open(flags.coordinator);
  if (!connection.ok()) return Complain("watch", connection.status());
  const std::string job = FullJobName(flags.job);
  return flags.json ? WatchAsJson(**connection, job, "watch") : WatchToTheEnd(**connection, job, "watch");
}

}  // namespace

void AddWatchCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<WatchFlags>();
  CLI::App* command = app.add_subcommand("watch", "Show how a job goes, until it has ended");
  command->footer(
      "Tiles done, time to go and what each worker does; plain lines where the output is no terminal. Goes on when "
      "the\n"
      "coordinator is restarted. Leaving it (Ctrl-C) does not touch the job. Exit code: 0 succeeded, 1 failed,\n"
      "3 failed for its input, 5 without some tiles, 130 cancelled.\n"
      "Example: tessera watch jobs/7");
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "The job's name or number")->required();
  command->add_flag("--json", flags->json, "One JSON object a change, on standard output");
  command->callback([flags, exit_code] { *exit_code = Watch(*flags); });
}

}  // namespace tessera
