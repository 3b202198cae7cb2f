// `tessera priority`, `pause`, `resume` and `retry`: change an accepted job.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>

#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/cli/watch_job.h"
#include "server/client/connection.h"
#include "server/client/job_text.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

struct ChangeFlags {
  Endpoint coordinator;
  std::string job;
  int priority = 0;
};

int Change(const ChangeFlags& flags, const std::string& command, v1::ChangeJobRequest request) {
  const auto connection = Connection::Open(flags.coordinator);
  if (!connection.ok()) return ReportError(command, connection.status());
  request.set_name(FullJobName(flags.job));
  v1::Job job;
  const Status status = (*connection)->ChangeJob(request, &job);
  if (!status.ok()) return ReportError(command, status);
  std::printf("%s %s, priority %d\n", job.name().c_str(), JobStatusName(job).c_str(), job.priority());
  return kExitOk;
}

CLI::App* AddCommand(CLI::App& app, const std::string& name, const std::string& what, ChangeFlags* flags) {
  CLI::App* command = app.add_subcommand(name, what);
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "The job's name or number")->required();
  return command;
}

void AddPausing(CLI::App& app, const std::string& name, const std::string& what, const std::string& details,
                bool paused, int* exit_code) {
  auto flags = std::make_shared<ChangeFlags>();
  CLI::App* command = AddCommand(app, name, what, flags.get());
  command->footer(details + "\nExample:\n  tessera " + name + " jobs/7");
  command->callback([flags, exit_code, name, paused] {
    v1::ChangeJobRequest request;
    request.set_paused(paused);
    *exit_code = Change(*flags, name, request);
  });
}

}  // namespace

void AddPriorityCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<ChangeFlags>();
  CLI::App* command = AddCommand(app, "priority", "Change a job's priority", flags.get());
  command->footer("Running tasks are not interrupted.\nExample:\n  tessera priority jobs/7 10");
  AddPriorityOption(*command, "PRIORITY", &flags->priority)->required();
  command->callback([flags, exit_code] {
    v1::ChangeJobRequest request;
    request.set_priority(flags->priority);
    *exit_code = Change(*flags, "priority", request);
  });
}

void AddPauseCommand(CLI::App& app, int* exit_code) {
  AddPausing(app, "pause", "Pause a job",
             "Leases no more tasks of the job. Running tasks finish, and their results are kept.", true, exit_code);
}

void AddResumeCommand(CLI::App& app, int* exit_code) {
  AddPausing(app, "resume", "Resume a paused job", "Leases tasks of the job again.", false, exit_code);
}

void AddRetryCommand(CLI::App& app, int* exit_code) {
  struct RetryFlags : ChangeFlags {
    int tile = -1;
    bool watch = false;
  };
  auto flags = std::make_shared<RetryFlags>();
  CLI::App* command = AddCommand(app, "retry", "Retry the failed tasks of a job", flags.get());
  command->footer(
      "The job must have failed or ended with quarantined tiles. Results of tasks that succeeded are kept.\n"
      "Examples:\n"
      "  tessera retry jobs/7 --watch\n"
      "  tessera retry jobs/7 --tile 12");
  CLI::Option* const tile = command->add_option("--tile", flags->tile, "Retry only the failed tasks of this tile")
                                ->check(CLI::NonNegativeNumber);
  command->add_flag("--watch", flags->watch, "Show progress until the job has ended");
  command->callback([flags, exit_code, tile] {
    const auto connection = Connection::Open(flags->coordinator);
    if (!connection.ok()) {
      *exit_code = ReportError("retry", connection.status());
      return;
    }
    v1::RetryJobRequest request;
    request.set_name(FullJobName(flags->job));
    if (tile->count() > 0) request.set_tile(flags->tile);
    v1::Job job;
    if (const Status status = (*connection)->RetryJob(request, &job); !status.ok()) {
      *exit_code = ReportError("retry", status);
      return;
    }
    std::printf("%s %s\n", job.name().c_str(), JobStatusName(job).c_str());
    std::fflush(stdout);
    *exit_code = flags->watch ? WatchJobWithProgress(**connection, job.name(), "retry") : kExitOk;
  });
}

}  // namespace tessera
