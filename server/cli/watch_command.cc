// `tessera watch`: follows a job.
#include <CLI/CLI.hpp>
#include <memory>

#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/cli/watch_job.h"
#include "server/client/connection.h"
#include "server/client/job_text.h"

namespace tessera {
namespace {

struct WatchFlags {
  Endpoint coordinator;
  std::string job;
  bool json = false;
};

int Watch(const WatchFlags& flags) {
  const auto connection = Connection::Open(flags.coordinator);
  if (!connection.ok()) return ReportError("watch", connection.status());
  const std::string job = FullJobName(flags.job);
  return flags.json ? WatchJobAsJson(**connection, job, "watch") : WatchJobWithProgress(**connection, job, "watch");
}

}  // namespace

void AddWatchCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<WatchFlags>();
  CLI::App* command = app.add_subcommand("watch", "Show the progress of a job until it has ended");
  command->footer(
      "Shows finished tiles, time left and the task of each worker; prints plain lines if the output is not a "
      "terminal.\n"
      "Reconnects when the coordinator restarts. Ctrl-C ends the command, not the job.\n"
      "Exit code: 0 succeeded, 1 failed, 3 wrong input, 5 some tiles are quarantined, 130 cancelled.\n"
      "Example:\n"
      "  tessera watch jobs/7");
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "The job's name or number")->required();
  command->add_flag("--json", flags->json, "Print one JSON object per change on standard output");
  command->callback([flags, exit_code] { *exit_code = Watch(*flags); });
}

}  // namespace tessera
