// `tessera rollback`: restores tiles of a job from an earlier job.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "common/storage/temporary_name.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/connection.h"
#include "server/client/job_text.h"
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

StatusOr<int> Rollback(const RollbackFlags& flags) {
  v1::CreateJobRequest request;
  v1::UpdateSettings& update = *request.mutable_settings()->mutable_update();
  update.set_base(FullJobName(flags.job));
  update.set_rollback_to(FullJobName(flags.to));
  update.mutable_rollback_tiles()->Add(flags.tiles.begin(), flags.tiles.end());
  request.set_display_name(flags.name);
  request.set_request_id(flags.request_id.empty() ? UniqueName() : flags.request_id);
  request.set_validate_only(flags.validate_only);
  TESSERA_ASSIGN_OR_RETURN(const auto connection, Connection::Open(flags.coordinator));
  v1::Job job;
  TESSERA_RETURN_IF_ERROR(connection->CreateJob(request, &job));
  if (flags.validate_only) {
    std::printf("%s: %s can be restored, %d tiles\n", update.base().c_str(), update.rollback_to().c_str(),
                job.settings().update().rollback_tiles_size());
    return kExitOk;
  }
  std::printf("%s\n", job.name().c_str());
  std::fflush(stdout);
  return flags.watch ? WatchJobWithProgress(*connection, job.name()) : kExitOk;
}

}  // namespace

void AddRollbackCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<RollbackFlags>();
  CLI::App* command = app.add_subcommand("rollback", "Restore tiles of a job from an earlier job");
  command->footer(
      "Creates a job with the given tiles of EARLIER and all other tiles of JOB, byte for byte; nothing is refined.\n"
      "EARLIER is a base job of JOB, or a base of its base (`tessera lineage` lists them). Tiles that share vertices\n"
      "and were refined by the same job must be restored together: if some are missing, the job is refused, and the\n"
      "error shows the command with all of them. The image list stays that of JOB: an update of the new job does not\n"
      "treat its images as new. To leave out a flight, withdraw it (`tessera update --withdraw`).\n"
      "Exit code: 0 succeeded, 1 failed, 2 wrong arguments, 3 wrong input, 4 coordinator unavailable.\n"
      "Examples:\n"
      "  tessera rollback jobs/7 --to jobs/3 --tile 12 --tile 13 --watch && tessera fetch jobs/8 --out city\n"
      "  tessera rollback jobs/7 --to jobs/3");
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "The job's name or number")->required();
  command->add_option("--to", flags->to, "Job to restore tiles from")->type_name("EARLIER")->required();
  command->add_option("--tile", flags->tiles, "Tile to restore; may be repeated (default: all tiles that differ)")
      ->check(CLI::NonNegativeNumber)
      ->allow_extra_args(false);
  command->add_option("--name", flags->name, "Display name of the new job (default: that of JOB)");
  command->add_option("--request-id", flags->request_id,
                      "Id of this submission: a repeated call with the same id returns the same job");
  command->add_flag("--validate-only", flags->validate_only, "Only check whether these tiles can be restored");
  command->add_flag("--watch", flags->watch, "Show progress until the job has ended");
  SetAction(command, exit_code, [flags] { return Rollback(*flags); });
}

}  // namespace tessera
