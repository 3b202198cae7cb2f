// `tessera plan`: predicts tiles, memory, time and price of a job.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>

#include "common/base/machine_limits.h"
#include "common/job/survey.h"
#include "common/job/task_kinds.h"
#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "common/storage/temporary_name.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/artifacts.h"
#include "server/client/base_job.h"
#include "server/client/connection.h"
#include "server/client/interrupt.h"
#include "server/client/local_cluster.h"
#include "server/display/plan_text.h"
#include "server/display/progress_display.h"
#include "server/display/update_text.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

constexpr double kPlanPollSeconds = 0.1;

struct PlanFlags {
  JobFlags job;
  std::string out, data, survey, map, json;
  Endpoint coordinator;
  PlanTerms terms;
};

const v1::Task* FindIngest(const v1::ListTasksResponse& tasks) {
  const auto found = std::find_if(tasks.tasks().begin(), tasks.tasks().end(),
                                  [](const v1::Task& task) { return task.kind() == kIngestKind; });
  return found == tasks.tasks().end() ? nullptr : &*found;
}

StatusOr<std::string> FetchSurvey(Connection& connection, const v1::Task& ingest, const std::string& staging) {
  for (const v1::OutputFile& output : ingest.outputs()) {
    if (output.name() != kSurveyFile) continue;
    const Digest digest = {output.digest().sha256(), output.digest().size_bytes()};
    TESSERA_ASSIGN_OR_RETURN(const auto store, FolderBlobs::Open(staging));
    TESSERA_RETURN_IF_ERROR(connection.blobs().Fetch(digest, *store, TaskControl()));
    return store->Read(digest);
  }
  return absl::InternalError("the ingest task has no survey among its outputs");
}

// The error of a failed job.
Status ErrorOf(Connection& connection, const v1::Job& job) {
  const bool input = connection.FailedForInput(job.name());
  return Status(input ? absl::StatusCode::kInvalidArgument : absl::StatusCode::kInternal, job.error());
}

// Waits until the task of the job that makes the survey has ended.
StatusOr<std::string> AwaitSurvey(Connection& connection, LocalCluster& cluster, const std::string& job,
                                  const std::string& staging, ProgressDisplay& display) {
  const Sleeper sleep = InterruptibleSleep(1);
  while (true) {
    v1::ListTasksResponse tasks;
    TESSERA_RETURN_IF_ERROR(connection.ListTasks(job, &tasks));
    if (const v1::Task* ingest = FindIngest(tasks); ingest != nullptr && ingest->state() == v1::TASK_STATE_SUCCEEDED) {
      return FetchSurvey(connection, *ingest, staging);
    }
    v1::WatchJobResponse update;
    TESSERA_RETURN_IF_ERROR(connection.GetJob(job, update.mutable_job()));
    if (update.job().state() == v1::JOB_STATE_FAILED) return ErrorOf(connection, update.job());
    for (const v1::Task& task : tasks.tasks()) {
      if (task.state() == v1::TASK_STATE_LEASED) *update.add_running() = task;
    }
    display.Show(update);
    std::vector<std::string> notes;
    const Status alive = cluster.Supervise(&notes);
    for (const std::string& note : notes) display.Note(note);
    TESSERA_RETURN_IF_ERROR(alive);
    if (!sleep(kPlanPollSeconds)) return absl::CancelledError("interrupted");
  }
}

// Submits the job and cancels it when it has the survey. A later run with the same state reuses these tasks.
StatusOr<std::string> ComputeSurvey(const PlanFlags& flags) {
  v1::CreateJobRequest request = MakeRequest(flags.job);
  TESSERA_RETURN_IF_ERROR(CheckSceneExists(request));
  request.set_request_id(UniqueName());
  InstallInterruptCounter();
  std::optional<TempFolder> own_folder;
  std::string state;
  if (flags.out.empty()) {
    TESSERA_ASSIGN_OR_RETURN(own_folder, TempFolder::Create("", "tessera-plan-"));
    state = own_folder->path() + "/state";
  } else {
    state = AbsolutePath(flags.out) + "/.tessera";
  }
  std::string survey;
  LocalClusterOptions options = {state, state + "/data", /*workers=*/1, /*threads_per_worker=*/CoreLimit()};
  options.scene = request.scene_path();
  const Status status = WithLocalCluster(options, [&](LocalCluster& cluster, Connection& connection) -> Status {
    v1::Job job;
    TESSERA_RETURN_IF_ERROR(connection.CreateJob(request, &job));
    ProgressDisplay display(stderr);
    auto found = AwaitSurvey(connection, cluster, job.name(), state + "/fetch", display);
    display.Finish();
    connection.CancelJob(job.name(), &job).IgnoreError();
    TESSERA_ASSIGN_OR_RETURN(survey, std::move(found));
    return absl::OkStatus();
  });
  RemoveTree(state + "/fetch").IgnoreError();
  TESSERA_RETURN_IF_ERROR(status);
  return survey;
}

// The content of a file that the job published.
StatusOr<std::string> FetchFile(Connection& connection, v1::Job job, const std::string& name) {
  TESSERA_RETURN_IF_ERROR(TakeArtifacts(connection, name, &job));
  TESSERA_ASSIGN_OR_RETURN(const TempFolder folder, TempFolder::Create("", "tessera-plan-"));
  TESSERA_RETURN_IF_ERROR(
      FetchArtifacts(connection, job, folder.path() + "/out", folder.path() + "/fetch", TaskControl()).status());
  return ReadFile(folder.path() + "/out/" + name);
}

// Runs the job, which is submitted with plan_only, and returns the plan that it publishes.
StatusOr<std::string> FetchUpdatePlan(Connection& connection, const v1::CreateJobRequest& request) {
  v1::Job job;
  TESSERA_RETURN_IF_ERROR(connection.CreateJob(request, &job));
  ProgressDisplay display(stderr);
  const Status watched = connection.WatchJob(job.name(), [&](const v1::WatchJobResponse& update) {
    job = update.job();
    display.Show(update);
    if (Interrupts() > 0) connection.StopWatching();
  });
  display.Finish();
  if (!watched.ok()) {
    connection.CancelJob(job.name(), &job).IgnoreError();
    return watched;
  }
  PrintWarnings(job.warnings());
  if (job.state() == v1::JOB_STATE_SUCCEEDED) return FetchFile(connection, job, kUpdateFile);
  return ErrorOf(connection, job);
}

StatusOr<std::string> ComputeUpdatePlan(const PlanFlags& flags) {
  v1::CreateJobRequest request = MakeRequest(flags.job);
  request.set_request_id(UniqueName());
  v1::UpdateSettings& update = *request.mutable_settings()->mutable_update();
  update.set_plan_only(true);
  InstallInterruptCounter();
  if (!flags.coordinator.address.empty()) {
    TESSERA_ASSIGN_OR_RETURN(const auto connection, Connection::Open(flags.coordinator));
    return FetchUpdatePlan(*connection, request);
  }
  TESSERA_ASSIGN_OR_RETURN(const RunResult base, ResolveBaseJob(update.base(), flags.data));
  update.set_base(base.job);
  TESSERA_ASSIGN_OR_RETURN(const TempFolder state, TempFolder::Create("", "tessera-plan-"));
  std::string plan;
  const auto fetch = [&](LocalCluster&, Connection& connection) -> Status {
    TESSERA_ASSIGN_OR_RETURN(plan, FetchUpdatePlan(connection, request));
    return absl::OkStatus();
  };
  TESSERA_RETURN_IF_ERROR(WithLocalCluster(
      {state.path() + "/state", base.data_dir, 1, CoreLimit(), /*shared_storage=*/true, request.scene_path()}, fetch));
  return plan;
}

StatusOr<int> PrintUpdatePlan(const PlanFlags& flags) {
  TESSERA_ASSIGN_OR_RETURN(const std::string plan, ComputeUpdatePlan(flags));
  TESSERA_ASSIGN_OR_RETURN(const std::string table, UpdateTable(plan, flags.terms));
  if (!flags.map.empty()) {
    TESSERA_ASSIGN_OR_RETURN(const std::string map, UpdateMap(plan));
    TESSERA_RETURN_IF_ERROR(WriteFileAtomic(flags.map, map));
  }
  if (!flags.json.empty()) TESSERA_RETURN_IF_ERROR(WriteFileAtomic(flags.json, plan));
  std::fputs(table.c_str(), stdout);
  return kExitOk;
}

StatusOr<int> Plan(const PlanFlags& flags) {
  if (!flags.job.settings.update.base.empty()) return PrintUpdatePlan(flags);
  StatusOr<std::string> survey_json = absl::NotFoundError("");
  if (!flags.survey.empty() && std::filesystem::exists(flags.survey)) {
    survey_json = ReadFile(flags.survey);
  } else {
    survey_json = ComputeSurvey(flags);
  }
  TESSERA_RETURN_IF_ERROR(survey_json.status());
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(*survey_json));
  if (!flags.survey.empty()) TESSERA_RETURN_IF_ERROR(WriteFileAtomic(flags.survey, *survey_json));
  TESSERA_ASSIGN_OR_RETURN(const Quote quote, MakeQuote(flags.job.settings, survey));
  if (!flags.map.empty()) TESSERA_RETURN_IF_ERROR(WriteFileAtomic(flags.map, PlanMap(quote, survey)));
  if (!flags.json.empty()) TESSERA_RETURN_IF_ERROR(WriteFileAtomic(flags.json, PlanJson(quote, flags.terms)));
  PrintWarnings(survey.warnings);
  std::fputs(PlanTable(quote, flags.terms).c_str(), stdout);
  return kExitOk;
}

}  // namespace

void AddPlanCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<PlanFlags>();
  CLI::App* command = app.add_subcommand("plan", "Predict tiles, memory, time and price of a job");
  command->footer(
      "Surveys the scene on this machine as a job's first task does (no refinement), computes the tiles that `run` or\n"
      "`submit` would use with the same options, and predicts memory and time of each with this version's cost model.\n"
      "The range after a total is the 90 % interval of prediction errors of single tasks that the model was fitted "
      "to.\n"
      "With --out, `tessera run --out` of the same folder reuses the survey.\n"
      "Exit code: 0 succeeded, 1 failed, 2 wrong arguments, 3 wrong input, 130 interrupted.\n"
      "Examples:\n"
      "  tessera plan city --workers 16 --map plan.svg\n"
      "  tessera plan city --tile-memory 2GiB --price-per-core-hour 0.05 --json plan.json\n"
      "  tessera plan city --out out && tessera run city --out out\n"
      "  tessera plan flight-2027 --base out --map update.svg");
  AddJobOptions(*command, &flags->job);
  AddUpdateOptions(
      *command,
      "The --out folder of an earlier run (with its .tessera); with --coordinator one of its jobs, such as jobs/3",
      &flags->job);
  AddExportOptions(*command, &flags->job.settings.exports);
  command->add_option("--coordinator", flags->coordinator.address,
                      "With --base: address of the coordinator of the base job, HOST:PORT or unix:PATH; it reads the "
                      "scene and plans");
  AddTlsOptions(*command, &flags->coordinator);
  command->add_option("--data", flags->data, "With --base jobs/J: state folder of the base job (--data of `run`)");
  command->add_option("--out", flags->out, "Keep the survey in this folder, for `tessera run --out`");
  command->add_option("--survey", flags->survey, "Read the survey from this file if it exists, else write it there");
  command->add_option("--workers", flags->terms.workers, "Number of workers for the predicted time")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command
      ->add_option("--threads-per-worker", flags->terms.threads_per_worker, "Cores per worker for the predicted time")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command
      ->add_option("--price-per-core-hour", flags->terms.price_per_core_hour,
                   "Price of one core-hour; without it no price is shown")
      ->check(CLI::NonNegativeNumber);
  command->add_option("--map", flags->map, "Draw tiles and cameras to this SVG file");
  command->add_option("--json", flags->json, "Also write the plan to this file, as JSON");
  SetAction(command, exit_code, [flags] { return Plan(*flags); });
}

}  // namespace tessera
