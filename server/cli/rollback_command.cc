// `tessera rollback`: takes tiles of a job back to what an earlier one left.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/cli/watching.h"
#include "server/client/connection.h"
#include "server/client/job_words.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

struct RollbackFlags {
  Endpoint coordinator;
  std::string job, to;
  std::vector<int> tiles;
  std::string name, request_id;
  bool validate_only = false, watch = false;
};

int Rollback(const RollbackFlags& flags) {
  v1::CreateJobRequest request;
  v1::UpdateSettings& update = *request.mutable_settings()->mutable_update();
  update.set_base(FullJobName(flags.job));
  update.set_rollback_to(FullJobName(flags.to));
  update.mutable_rollback_tiles()->Add(flags.tiles.begin(), flags.tiles.end());
  request.set_display_name(flags.name);
  request.set_request_id(flags.request_id.empty() ? NewRequestId() : flags.request_id);
  request.set_validate_only(flags.validate_only);
  const auto connection = Connection::Open(flags.coordinator);
  if (!connection.ok()) return Complain("rollback", connection.status());
  v1::Job job;
  if (const Status status = (*connection)->CreateJob(request, &job); !status.ok()) return Complain("rollback", status);
  if (flags.validate_only) {
    std::printf("%s: can go back to %s with %d tiles\n", update.base().c_str(), update.rollback_to().c_str(),
                job.settings().update().rollback_tiles_size());
    return kExitOk;
  }
  std::printf("%s\n", job.name().c_str());
  std::fflush(stdout);
  return flags.watch ? WatchToTheEnd(**connection, job.name(), "rollback") : kExitOk;
}

}  // namespace

void AddRollbackCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<RollbackFlags>();
  CLI::App* command = app.add_subcommand("rollback", "Take tiles of a job back to what an earlier job left");
  command->footer(
      "A new job with the tiles named as EARLIER left them, and all others as JOB did, to the byte; nothing is "
      "refined.\n"
      "EARLIER is a job that JOB goes on from (`tessera lineage`). Tiles that share vertices and that one job made "
      "anew\n"
      "go back together: where others have to go along, the job is refused with the command that names all of them.\n"
      "Images stay those of JOB, also where tiles go back: an update of the new job does not find them new. To leave "
      "a\n"
      "flight out, withdraw it (`tessera update --withdraw`).\n"
      "Exit code: 0 done, 1 failed, 2 wrong arguments, 3 wrong input, 4 no coordinator answers.\n"
      "Examples:\n"
      "  tessera rollback jobs/7 --to jobs/3 --tile 12 --tile 13 --watch && tessera fetch jobs/8 --out city\n"
      "  tessera rollback jobs/7 --to jobs/3");
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "The job's name or number")->required();
  command->add_option("--to", flags->to, "The earlier job")->type_name("EARLIER")->required();
  command->add_option("--tile", flags->tiles, "A tile to take back; may be repeated; without it all that differ")
      ->check(CLI::NonNegativeNumber)
      ->allow_extra_args(false);
  command->add_option("--name", flags->name, "Name for people; without it that of JOB");
  command->add_option("--request-id", flags->request_id, "The same id again gives the same job, never a second one");
  command->add_flag("--validate-only", flags->validate_only, "Only check whether these tiles can go back");
  command->add_flag("--watch", flags->watch, "Show progress until the job has ended");
  command->callback([flags, exit_code] { *exit_code = Rollback(*flags); });
}

}  // namespace tessera
