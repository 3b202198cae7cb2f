// Commands on one job: `tessera watch`, `priority`, `pause`, `resume`, `retry`, `cancel` and `delete`.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/connection.h"
#include "server/client/job_text.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

struct OneJobFlags {
  Endpoint coordinator;
  std::string job;
  int priority = 0, tile = -1;
  bool json = false, watch = false;
};

// Adds a command that connects to the coordinator and calls `run` with the job's full name in `flags`.
CLI::App* AddCommand(CLI::App& app, int* exit_code, const std::string& name, const std::string& what,
                     const std::string& details, const std::shared_ptr<OneJobFlags>& flags,
                     std::function<StatusOr<int>(Connection& connection)> run) {
  CLI::App* command = app.add_subcommand(name, what);
  command->footer(details);
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "The job's name or number")->required();
  SetAction(command, exit_code, [flags, run = std::move(run)]() -> StatusOr<int> {
    TESSERA_ASSIGN_OR_RETURN(const auto connection, Connection::Open(flags->coordinator));
    flags->job = FullJobName(flags->job);
    return run(*connection);
  });
  return command;
}

StatusOr<int> Change(Connection& connection, const std::string& name, v1::ChangeJobRequest request) {
  request.set_name(name);
  v1::Job job;
  TESSERA_RETURN_IF_ERROR(connection.ChangeJob(request, &job));
  std::printf("%s %s, priority %d\n", job.name().c_str(), JobStatusName(job).c_str(), job.priority());
  return kExitOk;
}

void AddPausing(CLI::App& app, const std::string& name, const std::string& what, const std::string& details,
                bool paused, int* exit_code) {
  auto flags = std::make_shared<OneJobFlags>();
  AddCommand(app, exit_code, name, what, details + "\nExample:\n  tessera " + name + " jobs/7", flags,
             [flags, paused](Connection& connection) {
               v1::ChangeJobRequest request;
               request.set_paused(paused);
               return Change(connection, flags->job, request);
             });
}

}  // namespace

void AddWatchCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<OneJobFlags>();
  CLI::App* command = AddCommand(
      app, exit_code, "watch", "Show the progress of a job until it has ended",
      "Shows finished tiles, time left and the task of each worker; prints plain lines if the output is not a "
      "terminal.\n"
      "Reconnects when the coordinator restarts. Ctrl-C ends the command, not the job.\n"
      "Exit code: 0 succeeded, 1 failed, 3 wrong input, 5 some tiles are quarantined or the result fits the images "
      "worse than the start mesh, 130 cancelled.\n"
      "Example:\n"
      "  tessera watch jobs/7",
      flags, [flags](Connection& connection) -> StatusOr<int> {
        if (!flags->json) return WatchJobWithProgress(connection, flags->job);
        return WatchJob(connection, flags->job, [](const v1::WatchJobResponse& update) {
          const StatusOr<std::string> line = ProtoJson(update, /*indented=*/false);
          if (!line.ok()) return;
          std::printf("%s\n", line->c_str());
          std::fflush(stdout);
        });
      });
  command->add_flag("--json", flags->json, "Print one JSON object per change on standard output");
}

void AddPriorityCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<OneJobFlags>();
  CLI::App* command = AddCommand(app, exit_code, "priority", "Change a job's priority",
                                 "Running tasks are not interrupted.\nExample:\n  tessera priority jobs/7 10", flags,
                                 [flags](Connection& connection) {
                                   v1::ChangeJobRequest request;
                                   request.set_priority(flags->priority);
                                   return Change(connection, flags->job, request);
                                 });
  AddPriorityOption(*command, "PRIORITY", &flags->priority)->required();
}

void AddPauseCommand(CLI::App& app, int* exit_code) {
  AddPausing(app, "pause", "Pause a job",
             "Leases no more tasks of the job. Running tasks finish, and their results are kept.", true, exit_code);
}

void AddResumeCommand(CLI::App& app, int* exit_code) {
  AddPausing(app, "resume", "Resume a paused job", "Leases tasks of the job again.", false, exit_code);
}

void AddRetryCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<OneJobFlags>();
  CLI::App* command = AddCommand(
      app, exit_code, "retry", "Retry the failed tasks of a job",
      "The job must have failed or ended with quarantined tiles. Results of tasks that succeeded are kept.\n"
      "Examples:\n"
      "  tessera retry jobs/7 --watch\n"
      "  tessera retry jobs/7 --tile 12",
      flags, [flags](Connection& connection) -> StatusOr<int> {
        v1::RetryJobRequest request;
        request.set_name(flags->job);
        if (flags->tile >= 0) request.set_tile(flags->tile);
        v1::Job job;
        TESSERA_RETURN_IF_ERROR(connection.RetryJob(request, &job));
        std::printf("%s %s\n", job.name().c_str(), JobStatusName(job).c_str());
        std::fflush(stdout);
        return flags->watch ? WatchJobWithProgress(connection, job.name()) : kExitOk;
      });
  command->add_option("--tile", flags->tile, "Retry only the failed tasks of this tile")->check(CLI::NonNegativeNumber);
  command->add_flag("--watch", flags->watch, "Show progress until the job has ended");
}

void AddCancelCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<OneJobFlags>();
  AddCommand(
      app, exit_code, "cancel", "Cancel a job",
      "The results of finished tasks are kept: the same job, submitted again, reuses them. A job that has ended does "
      "not\n"
      "change.\n"
      "Example:\n"
      "  tessera cancel jobs/7",
      flags, [flags](Connection& connection) -> StatusOr<int> {
        v1::Job job;
        TESSERA_RETURN_IF_ERROR(connection.CancelJob(flags->job, &job));
        std::printf("%s %s\n", job.name().c_str(), JobStateName(job.state()).c_str());
        return kExitOk;
      });
}

void AddDeleteCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<OneJobFlags>();
  AddCommand(
      app, exit_code, "delete", "Delete a job that has ended",
      "Results that no other job uses are removed; fetch them first. A base job (of an update or a rollback) cannot "
      "be\n"
      "deleted before the jobs that use it.\n"
      "Example:\n"
      "  tessera delete jobs/7",
      flags, [flags](Connection& connection) -> StatusOr<int> {
        TESSERA_RETURN_IF_ERROR(connection.DeleteJob(flags->job));
        std::printf("%s deleted\n", flags->job.c_str());
        return kExitOk;
      });
}

}  // namespace tessera
