// `tessera run`: runs one job on this machine with its own coordinator and workers.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>

#include "common/base/clock.h"
#include "common/base/machine_limits.h"
#include "common/base/printable.h"
#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "common/storage/temporary_name.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/base_job.h"
#include "server/client/interrupt.h"
#include "server/client/job_text.h"
#include "server/client/local_cluster.h"
#include "server/client/local_job.h"
#include "server/display/progress_display.h"
#include "server/display/run_summary.h"
#include "server/tiling/tiling.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

constexpr double kRunPollSeconds = 0.1;
constexpr double kCancelSeconds = 2;  // how long the calls of a cancelled job may take to end

struct RunFlags {
  JobFlags job;
  std::string out;
  std::string data;
  std::string timeline;
  int workers = 0;
  int threads_per_worker = 0;
  bool no_shared_storage = false;
};

// Folders of this run. A run whose scene is refused removes those that it created.
struct Folders {
  std::string out;
  std::string state;
  bool out_is_new = false;
  bool state_is_new = false;

  explicit Folders(const std::string& out_flag) {
    out = AbsolutePath(out_flag);
    state = out + "/.tessera";
    out_is_new = !std::filesystem::exists(out);
    state_is_new = !std::filesystem::exists(state);
  }
  void RemoveCreated() const {
    std::error_code ignored;
    if (state_is_new) std::filesystem::remove_all(state, ignored);
    if (out_is_new) std::filesystem::remove(out, ignored);  // only if it is empty
  }
};

struct RunOutcome {
  Status status;                       // error of a process or a call
  std::optional<LocalJobState> state;  // set if the job ended
  bool accepted = false;
  Warnings warnings;  // that were not shown yet
};

RunOutcome WaitForJob(LocalCluster& cluster, LocalJob& job, ProgressDisplay& display) {
  RunOutcome outcome;
  int warnings_seen = 0;
  while (Interrupts() == 0) {
    LocalJobState state = job.Wait(kRunPollSeconds);
    outcome.accepted = state.accepted;
    for (; state.job != nullptr && warnings_seen < state.job->warnings_size(); ++warnings_seen) {
      outcome.warnings.push_back(state.job->warnings(warnings_seen));
    }
    // Once the scene is accepted, and tiles are planned. If it is refused, the error comes first.
    if (state.job != nullptr && state.job->tiles_total() > 0) {
      for (const std::string& warning : ShortenMessages(std::exchange(outcome.warnings, {}))) {
        display.Note("warning: " + warning);
      }
    }
    if (state.update != nullptr) display.Show(*state.update);
    if (state.ended) {
      outcome.status = state.status;
      outcome.state = std::move(state);
      return outcome;
    }
    std::vector<std::string> notes;
    outcome.status = cluster.Supervise(&notes);
    for (const std::string& note : notes) display.Note(note);
    if (!outcome.status.ok()) return outcome;
  }
  display.Note("interrupted: stopping");
  job.Cancel();
  outcome.status = absl::CancelledError("interrupted");
  return outcome;
}

// `report_page`: path of the written page; empty: none.
int ReportOutcome(const RunOutcome& outcome, const Folders& folders, bool exports, const std::string& report_page,
                  double seconds) {
  if (!outcome.status.ok()) {
    const int code = ReportError("run", outcome.status);
    PrintWarnings(outcome.warnings);
    if (!outcome.accepted && code == kExitBadInput) folders.RemoveCreated();
    return outcome.accepted && code == kExitBadInput ? kExitFailed : code;
  }
  const int code = ExitCodeOfJob(*outcome.state->job, outcome.state->failed_for_input);
  PrintWarnings(outcome.warnings);
  if (code != kExitOk) std::fprintf(stderr, "logs: %s/logs\n", folders.state.c_str());
  if (code != kExitOk && code != kExitPartial) return code;
  for (const std::string& line : RunSummary(folders.out)) std::printf("%s\n", PrintableLines(line).c_str());
  std::printf("time: %s\n", FormatDuration(seconds).c_str());
  std::printf("result: %s/mesh.ply\n", folders.out.c_str());
  if (exports) std::printf("exports: %s/%s\n", folders.out.c_str(), kExportFolder);
  if (!report_page.empty()) std::printf("report: %s\n", report_page.c_str());
  return code == kExitOk && ResultIsWorse(folders.out) ? kExitPartial : code;
}

StatusOr<int> Run(const RunFlags& flags) {
  v1::CreateJobRequest request = MakeRequest(flags.job);
  TESSERA_RETURN_IF_ERROR(CheckSceneExists(request));
  request.set_request_id(UniqueName());
  std::string data_dir = flags.data.empty() ? "" : AbsolutePath(flags.data);
  if (v1::UpdateSettings& update = *request.mutable_settings()->mutable_update(); !update.base().empty()) {
    TESSERA_ASSIGN_OR_RETURN(const RunResult base, ResolveBaseJob(update.base(), data_dir));
    data_dir = base.data_dir;
    update.set_base(base.job);
  }

  InstallInterruptCounter();
  const SystemClock clock;
  const int64_t start_us = clock.MonotonicUs();
  const Folders folders(flags.out);
  const int cores = CoreLimit();
  LocalClusterOptions options;
  options.state_dir = folders.state;
  options.data_dir = data_dir.empty() ? folders.state + "/data" : data_dir;
  const int64_t tile_bytes = TileLimit_bytes(flags.job.settings.tiles, flags.job.settings.tile_memory_bytes);
  options.workers = flags.workers > 0 ? flags.workers : WorkersFor(cores, MemoryLimit_bytes(), tile_bytes);
  options.threads_per_worker = flags.threads_per_worker > 0 ? flags.threads_per_worker : cores;
  options.shared_storage = !flags.no_shared_storage;
  options.scene = request.scene_path();
  // The first interrupt aborts the start; the second aborts the orderly stop.
  TESSERA_ASSIGN_OR_RETURN(const auto cluster, LocalCluster::Start(options, clock, InterruptibleSleep(1)));
  TESSERA_ASSIGN_OR_RETURN(auto connection, Connection::Open(cluster->address()));

  ProgressDisplay display(stderr);
  auto job =
      std::make_unique<LocalJob>(std::move(connection), request, folders.out, folders.state + "/fetch", flags.timeline);
  const RunOutcome outcome = WaitForJob(*cluster, *job, display);
  display.Finish();
  // Close the connection before the coordinator stops, which otherwise waits for it. If a call hangs, the coordinator's
  // end terminates it.
  const int64_t deadline_us = clock.MonotonicUs() + static_cast<int64_t>(kCancelSeconds * 1e6);
  while (Interrupts() < 2 && clock.MonotonicUs() < deadline_us && !job->Wait(kRunPollSeconds).ended) {
  }
  if (job->Wait(0).ended) job.reset();
  cluster->Stop(LocalCluster::kStopSeconds, InterruptibleSleep(2));
  job.reset();
  if (outcome.state && outcome.state->job && outcome.state->job->state() == v1::JOB_STATE_SUCCEEDED) {
    TESSERA_RETURN_IF_ERROR(WriteRunResult(folders.state, {options.data_dir, outcome.state->job->name()}));
  }
  std::string report_page;
  if (outcome.status.ok() && outcome.state && HasResult(outcome.state->job->state())) {
    TaskControl control;
    control.cancelled = [] { return Interrupts() > 0; };
    report_page = WritePageOrWarn(*outcome.state->job, folders.out, control);
  }
  const bool exports = !flags.job.settings.exports.formats.empty();
  return ReportOutcome(outcome, folders, exports, report_page,
                       static_cast<double>(clock.MonotonicUs() - start_us) / 1e6);
}

}  // namespace

void AddRunCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<RunFlags>();
  CLI::App* command = app.add_subcommand("run", "Refine a scene on this machine");
  command->footer(
      "Starts a private coordinator and workers, runs the job, and writes mesh.ply, report.json and job.json to OUT,\n"
      "and report.html: the same as one page with pictures and plots, for any browser.\n"
      "Results appear in OUT only when all are complete. The folder OUT/.tessera keeps the output of every task and\n"
      "the logs: a run that is interrupted or repeated does not compute a task twice. It may be deleted unless a "
      "later\n"
      "run is to use this one as its base job (--base).\n"
      "Exit code: 0 succeeded, 1 failed, 2 wrong arguments, 3 wrong input, 5 some tiles are quarantined, or\n"
      "the result fits the images worse than the start mesh, 130 interrupted.\n"
      "Examples:\n"
      "  tessera run city --workers 2 --tiles 4 --out out\n"
      "  tessera run city --classifier city.model --out out      likelihoods from a trained model\n"
      "  tessera run flight-2027 --base out --out out-2027");
  AddJobOptions(*command, &flags->job);
  AddUpdateOptions(*command, "The --out folder of an earlier run (with its .tessera), or jobs/J of --data",
                   &flags->job);
  AddExportOptions(*command, &flags->job.settings.exports);
  AddPriceLimit(*command, &flags->job);
  command->add_option("--out", flags->out, "Folder for the results")->required();
  command->add_option("--data", flags->data, "Folder for the coordinator's state (default OUT/.tessera/data)");
  command->add_option("--timeline", flags->timeline,
                      "Write a Chrome trace, one track per worker, to this file; open it with ui.perfetto.dev");
  command
      ->add_option("--workers", flags->workers,
                   "Number of worker processes; 0: one per 4 cores, as far as each has memory for a tile, but at least "
                   "two (one on a single core); two if --tiles is given without --tile-memory")
      ->check(CLI::Range(0, 256))
      ->capture_default_str();
  command
      ->add_option("--threads-per-worker", flags->threads_per_worker,
                   "Largest number of threads of a task; 0: all cores, shared between the running tasks")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  command->add_flag("--no-shared-storage", flags->no_shared_storage,
                    "Transfer all data through the blob service, as workers on other machines do");
  SetAction(command, exit_code, [flags] { return Run(*flags); });
}

}  // namespace tessera
