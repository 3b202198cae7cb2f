// `tessera submit` and `tessera update`: submit a job to a coordinator.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

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

StatusOr<int> Submit(const SubmitFlags& flags) {
  v1::CreateJobRequest request = MakeRequest(flags.job);
  if (v1::UpdateSettings& update = *request.mutable_settings()->mutable_update(); !update.base().empty()) {
    update.set_base(FullJobName(update.base()));
  }
  request.set_display_name(flags.name);
  request.set_priority(flags.priority);
  request.set_request_id(flags.request_id.empty() ? UniqueName() : flags.request_id);
  request.set_validate_only(flags.validate_only);
  TESSERA_ASSIGN_OR_RETURN(const auto connection, Connection::Open(flags.coordinator));
  v1::Job job;
  TESSERA_RETURN_IF_ERROR(connection->CreateJob(request, &job));
  PrintWarnings(job.warnings());
  if (flags.validate_only) {
    std::printf("%s: valid\n", request.scene_path().c_str());
    return kExitOk;
  }
  std::printf("%s\n", job.name().c_str());
  std::fflush(stdout);
  return flags.watch ? WatchJobWithProgress(*connection, job.name()) : kExitOk;
}

constexpr char kBaseValues[] = "a job of the coordinator, such as jobs/3";

void AddOptions(CLI::App& command, SubmitFlags* flags) {
  AddCoordinatorOption(command, &flags->coordinator);
  AddJobOptions(command, &flags->job);
  AddUpdateOptions(command, kBaseValues, &flags->job);
  AddPriceLimit(command, &flags->job);
  command.add_option("--name", flags->name, "Display name of the job (default: the scene's name)");
  command.add_option("--request-id", flags->request_id,
                     "Id of this submission: a repeated call with the same id returns the same job");
  AddPriorityOption(command, "--priority", &flags->priority);
  command.add_flag("--validate-only", flags->validate_only,
                   "Only check whether the coordinator accepts the scene and the settings");
  command.add_flag("--watch", flags->watch, "Show progress until the job has ended");
}

}  // namespace

void AddSubmitCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<SubmitFlags>();
  CLI::App* command = app.add_subcommand("submit", "Submit a job to a coordinator");
  command->footer(
      "Prints the job's name. The coordinator reads the scene from the same path, so SCENE must be on a file system "
      "that\n"
      "both machines mount.\n"
      "Examples:\n"
      "  tessera submit city --tiles 16 --watch\n"
      "  job=$(tessera submit city --tiles 16 --coordinator city-server:7575)\n"
      "  tessera watch $job && tessera fetch $job --out result");
  AddOptions(*command, flags.get());
  SetAction(command, exit_code, [flags] { return Submit(*flags); });
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
  SetAction(command, exit_code, [flags] { return Submit(*flags); });
}

}  // namespace tessera
