// `tessera submit`, `tessera update` and `tessera rollback`: submit a job to a coordinator.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
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

struct SubmitFlags {
  Endpoint coordinator;
  JobFlags job;
  std::string name;
  std::string request_id;
  int priority = 0;
  bool validate_only = false;
  bool watch = false;
};

// Creates the job, or calls `print_valid` with the checked job if it is only to be validated.
StatusOr<int> Submit(const SubmitFlags& flags, v1::CreateJobRequest request,
                     const std::function<void(const v1::Job&)>& print_valid) {
  request.set_display_name(flags.name);
  request.set_priority(flags.priority);
  request.set_request_id(flags.request_id.empty() ? UniqueName() : flags.request_id);
  request.set_validate_only(flags.validate_only);
  TESSERA_ASSIGN_OR_RETURN(const auto connection, Connection::Open(flags.coordinator));
  v1::Job job;
  TESSERA_RETURN_IF_ERROR(connection->CreateJob(request, &job));
  PrintWarnings(job.warnings());
  if (flags.validate_only) {
    print_valid(job);
    return kExitOk;
  }
  std::printf("%s\n", job.name().c_str());
  std::fflush(stdout);
  return flags.watch ? WatchJobWithProgress(*connection, job.name()) : kExitOk;
}

StatusOr<int> SubmitScene(const SubmitFlags& flags) {
  v1::CreateJobRequest request = MakeRequest(flags.job);
  if (v1::UpdateSettings& update = *request.mutable_settings()->mutable_update(); !update.base().empty()) {
    update.set_base(FullJobName(update.base()));
  }
  return Submit(flags, request, [&](const v1::Job&) { std::printf("%s: valid\n", request.scene_path().c_str()); });
}

StatusOr<int> SubmitRollback(const SubmitFlags& flags, const std::string& base, const std::string& earlier,
                             const std::vector<int>& tiles) {
  v1::CreateJobRequest request;
  v1::UpdateSettings& update = *request.mutable_settings()->mutable_update();
  update.set_base(FullJobName(base));
  update.set_rollback_to(FullJobName(earlier));
  update.mutable_rollback_tiles()->Add(tiles.begin(), tiles.end());
  return Submit(flags, request, [&](const v1::Job& job) {
    std::printf("%s: %s can be restored, %d tiles\n", update.base().c_str(), update.rollback_to().c_str(),
                job.settings().update().rollback_tiles_size());
  });
}

constexpr char kBaseValues[] = "a job of the coordinator, such as jobs/3";

// Adds the options of all submissions but the coordinator's. `name`, `validated`: the help of --name and
// --validate-only.
void AddSubmitOptions(CLI::App& command, const std::string& name, const std::string& validated, SubmitFlags* flags) {
  command.add_option("--name", flags->name, name);
  command.add_option("--request-id", flags->request_id,
                     "Id of this submission: a repeated call with the same id returns the same job");
  command.add_flag("--validate-only", flags->validate_only, validated);
  command.add_flag("--watch", flags->watch, "Show progress until the job has ended");
}

void AddOptions(CLI::App& command, SubmitFlags* flags) {
  AddCoordinatorOption(command, &flags->coordinator);
  AddJobOptions(command, &flags->job);
  AddUpdateOptions(command, kBaseValues, &flags->job);
  AddExportOptions(command, &flags->job.settings.exports);
  AddPriceLimit(command, &flags->job);
  AddPriorityOption(command, "--priority", &flags->priority);
  AddSubmitOptions(command, "Display name of the job (default: the scene's name)",
                   "Only check whether the coordinator accepts the scene and the settings", flags);
}

}  // namespace

void AddSubmitCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<SubmitFlags>();
  CLI::App* command = app.add_subcommand("submit", "Submit a job to a coordinator");
  command->footer(
      "Prints the job's name. The coordinator reads the scene from the same place: a path on a file system that both\n"
      "machines mount, or s3://BUCKET/PREFIX of tessera upload, which only the coordinator needs credentials for.\n"
      "Examples:\n"
      "  tessera submit city --tiles 16 --watch\n"
      "  job=$(tessera submit city --tiles 16 --coordinator city-server:7575)\n"
      "  job=$(tessera submit s3://scenes/city --coordinator city-server:7575)\n"
      "  tessera watch $job && tessera fetch $job --out result");
  AddOptions(*command, flags.get());
  SetAction(command, exit_code, [flags] { return SubmitScene(*flags); });
}

void AddUpdateCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<SubmitFlags>();
  CLI::App* command = app.add_subcommand("update", "Submit a new flight over part of a city to a coordinator");
  command->footer(
      "As `submit`, with --base required: the job updates the result of its base job. `tessera plan --base` shows\n"
      "beforehand which tiles it would refine, and the cost.\n"
      "Example:\n"
      "  tessera update flight-2027 --base jobs/1 --watch && tessera fetch jobs/2 --out city-2027");
  AddOptions(*command, flags.get());
  command->get_option("--base")->required();
  SetAction(command, exit_code, [flags] { return SubmitScene(*flags); });
}

void AddRollbackCommand(CLI::App& app, int* exit_code) {
  struct Flags : SubmitFlags {
    std::string base, earlier;
    std::vector<int> tiles;
  };
  auto flags = std::make_shared<Flags>();
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
  command->add_option("JOB", flags->base, "The job's name or number")->required();
  command->add_option("--to", flags->earlier, "Job to restore tiles from")->type_name("EARLIER")->required();
  command->add_option("--tile", flags->tiles, "Tile to restore; may be repeated (default: all tiles that differ)")
      ->check(CLI::NonNegativeNumber)
      ->allow_extra_args(false);
  AddSubmitOptions(*command, "Display name of the new job (default: that of JOB)",
                   "Only check whether these tiles can be restored", flags.get());
  SetAction(command, exit_code, [flags] { return SubmitRollback(*flags, flags->base, flags->earlier, flags->tiles); });
}

}  // namespace tessera
