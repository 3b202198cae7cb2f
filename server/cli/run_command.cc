// `tessera run`: a coordinator and workers for one job on this machine.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <thread>

#include "common/base/clock.h"
#include "common/base/machine_limits.h"
#include "common/base/printable.h"
#include "common/storage/files.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/base_job.h"
#include "server/client/interrupt.h"
#include "server/client/job_words.h"
#include "server/client/local_cluster.h"
#include "server/client/local_job.h"
#include "server/display/progress_display.h"
#include "server/display/run_summary.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

constexpr double kLookSeconds = 0.1;
constexpr double kCancelSeconds = 2;  // for the job's calls to end after it was cancelled

struct RunFlags {
  JobFlags job;
  std::string out;
  std::string data;
  std::string timeline;
  int workers = 0;
  int threads_per_worker = 0;
  bool no_shared_storage = false;
};

// What this run made on disk beside the results, to be taken away again if it comes to nothing.
struct Folders {
  std::string out;
  std::string state;
  bool out_is_new = false;
  bool state_is_new = false;

  explicit Folders(const std::string& out_flag) {
    out = std::filesystem::absolute(out_flag).lexically_normal().string();
    while (out.size() > 1 && out.back() == '/') out.pop_back();
    state = out + "/.tessera";
    out_is_new = !std::filesystem::exists(out);
    state_is_new = !std::filesystem::exists(state);
  }
  void RemoveTraces() const {
    std::error_code ignored;
    if (state_is_new) std::filesystem::remove_all(state, ignored);
    if (out_is_new) std::filesystem::remove(out, ignored);  // only if it is empty
  }
};

// How the job went; empty if the run was interrupted before it ended.
struct Ending {
  Status status;                       // trouble with processes or calls
  std::optional<LocalJobState> state;  // of a job that ended
  bool accepted = false;
};

Ending Follow(LocalCluster& cluster, LocalJob& job, ProgressDisplay& display) {
  Ending ending;
  int warnings_told = 0;
  while (Interrupts() == 0) {
    LocalJobState state = job.Wait(kLookSeconds);
    ending.accepted = state.accepted;
    for (; state.job != nullptr && warnings_told < state.job->warnings_size(); ++warnings_told) {
      display.Note("warning: " + state.job->warnings(warnings_told));
    }
    if (state.update != nullptr) display.Show(*state.update);
    if (state.ended) {
      ending.status = state.status;
      ending.state = std::move(state);
      return ending;
    }
    std::vector<std::string> notes;
    ending.status = cluster.LookAfter(&notes);
    for (const std::string& note : notes) display.Note(note);
    if (!ending.status.ok()) return ending;
  }
  display.Note("interrupted: stopping");
  job.Cancel();
  ending.status = absl::CancelledError("interrupted");
  return ending;
}

int Conclude(const Ending& ending, const Folders& folders, double seconds) {
  if (!ending.status.ok()) {
    const int code = Complain("run", ending.status);
    if (!ending.accepted && code == kExitBadInput) folders.RemoveTraces();
    return ending.accepted && code == kExitBadInput ? kExitFailed : code;
  }
  const int code = ExitCodeOfJob(*ending.state->job, ending.state->failed_for_input);
  if (code != kExitOk) std::fprintf(stderr, "logs: %s/logs\n", folders.state.c_str());
  if (code != kExitOk && code != kExitPartial) return code;
  for (const std::string& line : RunSummary(folders.out)) std::printf("%s\n", PrintableLines(line).c_str());
  std::printf("time: %s\n", DurationWords(seconds).c_str());
  std::printf("result: %s/mesh.ply\n", folders.out.c_str());
  return code;
}

int Run(const RunFlags& flags) {
  v1::CreateJobRequest request;
  if (const Status status = MakeRequest(flags.job, &request); !status.ok()) return Complain("run", status);
  std::error_code error;
  if (!std::filesystem::exists(request.scene_path(), error)) {
    return Complain("run", absl::InvalidArgumentError(request.scene_path() + ": no such folder, expected a scene"));
  }
  request.set_request_id(NewRequestId());
  std::string data_dir;
  if (!flags.data.empty()) data_dir = std::filesystem::absolute(flags.data).lexically_normal().string();
  if (v1::UpdateSettings& update = *request.mutable_settings()->mutable_update(); !update.base().empty()) {
    const auto base = FindBase(update.base(), data_dir);
    if (!base.ok()) return Complain("run", base.status());
    data_dir = base->data_dir;
    update.set_base(base->job);
  }

  CountInterrupts();
  const SystemClock clock;
  const int64_t start_us = clock.MonotonicUs();
  const Folders folders(flags.out);
  const int cores = CoreLimit();
  LocalClusterOptions options;
  options.state_dir = folders.state;
  options.data_dir = data_dir.empty() ? folders.state + "/data" : data_dir;
  options.workers = flags.workers > 0 ? flags.workers : std::min(2, cores);
  options.threads_per_worker = flags.threads_per_worker > 0 ? flags.threads_per_worker : cores;
  options.shared_storage = !flags.no_shared_storage;
  // A first interrupt breaks the start off; a second one the orderly end.
  const auto until = [](int interrupts) {
    return [interrupts](double seconds) {
      std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
      return Interrupts() < interrupts;
    };
  };
  const auto cluster = LocalCluster::Start(options, clock, until(1));
  if (!cluster.ok()) return Complain("run", cluster.status());
  auto connection = Connection::Open((*cluster)->address());
  if (!connection.ok()) return Complain("run", connection.status());

  ProgressDisplay display(stderr);
  auto job = std::make_unique<LocalJob>(*std::move(connection), request, folders.out, folders.state + "/fetch",
                                        flags.timeline);
  const Ending ending = Follow(**cluster, *job, display);
  display.Finish();
  // The connection goes first, or the coordinator waits for it; unless a call hangs, which the coordinator's end
  // breaks.
  const int64_t patience_us = clock.MonotonicUs() + static_cast<int64_t>(kCancelSeconds * 1e6);
  while (Interrupts() < 2 && clock.MonotonicUs() < patience_us && !job->Wait(kLookSeconds).ended) {
  }
  if (job->Wait(0).ended) job.reset();
  (*cluster)->Stop(LocalCluster::kStopSeconds, until(2));
  job.reset();
  if (ending.state && ending.state->job && ending.state->job->state() == v1::JOB_STATE_SUCCEEDED) {
    const Status status = WriteRunResult(folders.state, {options.data_dir, ending.state->job->name()});
    if (!status.ok()) return Complain("run", status);
  }
  return Conclude(ending, folders, static_cast<double>(clock.MonotonicUs() - start_us) / 1e6);
}

}  // namespace

void AddRunCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<RunFlags>();
  CLI::App* command = app.add_subcommand("run", "Refine a scene on this machine, from start to end");
  command->footer(
      "Starts a coordinator and workers that nobody else can use, runs the job, writes mesh.ply, report.json and "
      "job.json to the\n"
      "folder, and stops them. Results appear there only when all are complete. The folder .tessera in it keeps what\n"
      "every task made (a run that was interrupted, or is repeated, does nothing twice) and the logs; it may be "
      "deleted,\n"
      "unless a later run is to go on from this one (--base).\n"
      "Exit code: 0 done, 1 failed, 2 wrong arguments, 3 wrong input, 5 done but for tiles whose refinement failed,\n"
      "130 interrupted.\n"
      "Examples:\n"
      "  tessera run city --workers 2 --tiles 4 --out out\n"
      "  tessera run city --classifier city.model --out out      likelihoods by what `tessera classify` learnt\n"
      "  tessera run flight-2027 --base out --out out-2027");
  AddJobOptions(*command, &flags->job);
  AddUpdateOptions(*command, "the folder with an earlier run's results, with its .tessera, or jobs/J of --data",
                   &flags->job);
  AddPriceLimit(*command, &flags->job);
  command->add_option("--out", flags->out, "Folder for the results")->required();
  command->add_option("--data", flags->data, "The coordinator's state; without it OUT/.tessera/data");
  command->add_option("--timeline", flags->timeline,
                      "File for who did what when, which ui.perfetto.dev and chrome://tracing show");
  command->add_option("--workers", flags->workers, "Worker processes; 0: two, or one on one core")
      ->check(CLI::Range(0, 256))
      ->capture_default_str();
  command
      ->add_option("--threads-per-worker", flags->threads_per_worker,
                   "Threads of a task at most; 0: as the work at hand shares the cores out")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  command->add_flag("--no-shared-storage", flags->no_shared_storage,
                    "Move all data through the blob service, as workers on other machines do");
  command->callback([flags, exit_code] { *exit_code = Run(*flags); });
}

}  // namespace tessera
