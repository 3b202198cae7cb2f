// dispatch_bench [--tiles 9] [--workers 2]: what a task costs beside its work. Runs a job whose tasks do nothing but
// write files as large as those of a real one, through a coordinator and worker processes over loopback as `tessera
// run` has them, and prints a task's share of the clock and of both sides' processor time. --empty writes empty files:
// what is left is dispatch.
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <thread>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "common/base/version.h"
#include "common/job/task_parameters.h"
#include "common/log/log.h"
#include "common/storage/files.h"
#include "tests/bench/bench_coordinator.h"
#include "tests/bench/dispatch_fleet.h"
#include "tests/bench/synthetic_survey.h"
#include "worker/agent/agent.h"

namespace tessera {
namespace {

constexpr double kNearGsd = 250, kSolveNearGsd = 160;  // of tiles that read each other

struct Arguments {
  SyntheticCity city = {.images = 30, .faces = 187e3};
  int tiles = 9, workers = 2;
  bool empty = false, no_shared_storage = false;
};

double Seconds() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

// The plan as it is, but that no task reads files of a scene: there is none.
class BarePlanner : public Planner {
 public:
  StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings& settings, const std::string& survey,
                                           const std::vector<std::string>& files, const UpdateBase*,
                                           const FinePart* fine) override {
    return Bare(PlanTiles(settings, survey, files, nullptr, fine));
  }
  StatusOr<std::vector<PlannedTask>> Steps(const JobSettings& settings, const std::string& survey,
                                           const std::vector<std::string>& files, const std::vector<TileReads>& reads,
                                           const UpdateBase*, const std::vector<FailedTile>&,
                                           const FinePart* fine) override {
    return Bare(PlanSteps(settings, survey, files, reads, nullptr, {}, fine));
  }
  StatusOr<std::vector<PlannedTask>> Ingest(const JobSettings& settings, const std::vector<std::string>& files,
                                            const std::vector<int64_t>& size_bytes) override {
    return Bare(PlanIngest(settings, files, size_bytes));
  }

 private:
  static StatusOr<std::vector<PlannedTask>> Bare(StatusOr<std::vector<PlannedTask>> tasks) {
    if (tasks.ok()) {
      for (PlannedTask& task : *tasks) {
        task.scene_files.Clear();
        task.view_files.Clear();
      }
    }
    return tasks;
  }
};

// Bytes of the files that tasks make, about as a tile of a ninth of `campus` has them.
class FileWriter {
 public:
  explicit FileWriter(const Arguments& arguments)
      : arguments_(arguments), survey_(MakeSyntheticSurvey(arguments.city)) {}

  StatusOr<TaskOutcome> Run(const TaskRequest& request) const {
    TaskOutcome outcome;
    const auto write = [&](const std::string& name, const std::string& content) {
      outcome.outputs.push_back(name);
      return WriteFileAtomic(request.output_dir + "/" + name, content);
    };
    // Other bytes for each task, so that nothing is stored already.
    const auto blob = [&](double mib) {
      std::string bytes = request.kind + request.parameters;
      if (!arguments_.empty) bytes.resize(static_cast<size_t>(mib * (1 << 20)), 'x');
      return bytes;
    };
    if (request.kind == kInspectKind) {
      TESSERA_RETURN_IF_ERROR(write(kInspectionFile, blob(0.02)));
    } else if (request.kind == kIngestKind) {
      TESSERA_RETURN_IF_ERROR(write(kCityFile, blob(20)));
      TESSERA_RETURN_IF_ERROR(write(kSurveyFile, SurveyToJson(survey_)));
      TESSERA_RETURN_IF_ERROR(write(kPlainSurveyFile, ""));
    } else if (request.kind == kSplitKind) {
      for (const char* name : {kCityFile, kMovedFile}) TESSERA_RETURN_IF_ERROR(write(name, blob(20)));
      TESSERA_RETURN_IF_ERROR(write(kSurveyFile, SurveyToJson(survey_)));
      TESSERA_RETURN_IF_ERROR(write(kPlainSurveyFile, "after the split"));
    } else if (request.kind == kCutKind) {
      TESSERA_ASSIGN_OR_RETURN(const CutParameters cut, ParseCutParameters(request.parameters));
      TESSERA_RETURN_IF_ERROR(write(kTileFile, blob(4)));
      TESSERA_RETURN_IF_ERROR(write(kReadsFile, ReadsOf(cut)));
    } else if (request.kind == "crop") {
      TESSERA_RETURN_IF_ERROR(write(kViewsFile, blob(20)));
    } else if (request.kind == "measure") {
      TESSERA_RETURN_IF_ERROR(write(kSumsFile, blob(2)));
    } else if (request.kind == kPublishKind) {
      TESSERA_RETURN_IF_ERROR(write(kMeshFile, blob(10)));
    } else {
      TESSERA_RETURN_IF_ERROR(write(kStateFile, blob(0.5)));
    }
    outcome.stats = R"({"seconds":0})";
    return outcome;
  }

 private:
  std::string ReadsOf(const CutParameters& cut) const {
    const auto within = [&](double gsd) {
      std::vector<int> ids;
      for (int tile = 0; tile < static_cast<int>(cut.cores.size()); ++tile) {
        const double gap_m = DistanceBetween(cut.cores[tile], cut.tile.core, survey_.ground.cell_m);
        if (gap_m <= gsd * survey_.gsd_m) ids.push_back(tile);
      }
      return ids;
    };
    const std::vector<int> near = within(kNearGsd);
    return ToJson(TileReads{near, near, near, within(kSolveNearGsd)});
  }

  const Arguments& arguments_;
  const Survey survey_;
};

// A worker process, from the moment that the coordinator's address is in the file.
int Work(const Arguments& arguments, const std::string& address_file, const std::string& folder) {
  std::string address;
  while (address.empty()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    address = ReadFile(address_file).value_or("");
  }
  const FileWriter writer(arguments);
  if (!SetUpLog("off", false).ok()) return 1;
  AgentOptions options;
  options.coordinator = address;
  options.work_dir = folder;
  options.use_shared_storage = !arguments.no_shared_storage;
  options.description = {"host", getpid(), 1, int64_t{1} << 34, kAlgorithmVersion, 2, ""};
  double in_tasks_s = 0;
  const auto agent = Agent::Create(options, [&](const TaskRequest& request, const TaskControl&) {
    const double start_s = Seconds();
    auto outcome = writer.Run(request);
    in_tasks_s += Seconds() - start_s;
    if (request.kind == kPublishKind) std::fflush(stdout);
    return outcome;
  });
  if (!agent.ok()) return 1;
  // Drains when the address is taken away.
  std::thread end([&] {
    while (FileExists(address_file)) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    (*agent)->Drain();
  });
  const double start_s = CpuSeconds(RUSAGE_SELF);
  const Status status = (*agent)->Run();
  end.join();
  std::printf("worker: %.2f core-seconds, %.2f s within tasks\n", CpuSeconds(RUSAGE_SELF) - start_s, in_tasks_s);
  std::fflush(stdout);
  return status.ok() ? 0 : 1;
}

Status Serve(const Arguments& arguments, const std::string& folder, const std::string& address_file) {
  BarePlanner planner;
  TESSERA_ASSIGN_OR_RETURN(const auto served, BenchCoordinator::Start(folder, &planner, /*shared_storage=*/true));
  Coordinator& coordinator = served->coordinator();
  NewJob job;
  job.scene_path = "/scene";
  job.settings.tiles = arguments.tiles;
  const Digest nothing = {Sha256Hex(""), 0};
  for (const SceneView& view : MakeSyntheticSurvey(arguments.city).views) {
    job.scene_files.push_back({view.image_path, nothing});
    job.scene_files.push_back({view.likelihood_path, nothing});
  }
  const double start_s = Seconds(), start_cpu_s = CpuSeconds(RUSAGE_SELF);
  TESSERA_ASSIGN_OR_RETURN(JobStatus status, coordinator.jobs().CreateJob(job));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(address_file, served->address()));
  while (!HasEnded(status.header.state)) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    TESSERA_ASSIGN_OR_RETURN(status, coordinator.jobs().GetJob(status.header.name));
  }
  const double wall_s = Seconds() - start_s, cpu_s = CpuSeconds(RUSAGE_SELF) - start_cpu_s;
  TESSERA_RETURN_IF_ERROR(RemoveTree(address_file));
  while (wait(nullptr) > 0) {
  }
  if (status.header.state != JobState::kSucceeded) return absl::InternalError(status.header.error);
  const double tasks = status.tasks_total, worker_cpu_s = CpuSeconds(RUSAGE_CHILDREN);
  std::printf(
      "%d tasks, %d workers: %.2f s, %.2f ms of the clock a task and worker; processor time a task: coordinator "
      "%.2f ms, worker %.2f ms\n",
      status.tasks_total, arguments.workers, wall_s, 1e3 * wall_s * arguments.workers / tasks, 1e3 * cpu_s / tasks,
      1e3 * worker_cpu_s / tasks);
  return absl::OkStatus();
}

Status Run(const Arguments& arguments, const std::string& parent) {
  TESSERA_ASSIGN_OR_RETURN(const TempFolder folder, TempFolder::Create(parent, "dispatch_bench-"));
  const std::string address_file = folder.path() + "/address";
  for (int i = 0; i < arguments.workers; ++i) {
    if (fork() == 0) _exit(Work(arguments, address_file, folder.path() + "/worker-" + std::to_string(i)));
  }
  return Serve(arguments, folder.path(), address_file);
}

// A fleet in a process of its own: 0 tasks a second if it fails.
double FleetInChild(const FleetArguments& fleet, const std::string& folder, const std::string& state) {
  int result[2] = {};
  if (pipe(result) != 0) return 0;
  if (fork() == 0) {
    const auto rate = RunFleet(fleet, folder, state);
    if (!rate.ok()) std::fprintf(stderr, "dispatch_bench: %s\n", std::string(rate.status().message()).c_str());
    std::fflush(stdout);
    const double value = rate.value_or(0);
    _exit(write(result[1], &value, sizeof(value)) == sizeof(value) ? 0 : 1);
  }
  double value = 0;
  close(result[1]);
  const bool got = read(result[0], &value, sizeof(value)) == sizeof(value);
  close(result[0]);
  while (wait(nullptr) > 0) {
  }
  return got ? value : 0;
}

// The same fleet on SQLite and on PostgreSQL.
Status CompareStates(const FleetArguments& fleet, const std::string& folder, const std::string& state) {
  std::printf("SQLite:\n");
  std::fflush(stdout);
  const double sqlite = FleetInChild(fleet, folder + "/sqlite", "");
  std::printf("PostgreSQL:\n");
  std::fflush(stdout);
  const double postgres = FleetInChild(fleet, folder + "/postgresql", state);
  if (sqlite == 0 || postgres == 0) return absl::InternalError("a run has failed");
  std::printf("tasks a second on PostgreSQL / SQLite: %.0f / %.0f = %.2f\n", postgres, sqlite, postgres / sqlite);
  return absl::OkStatus();
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  // As the coordinator does, so that the fleet takes less of the processors.
  absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
  tessera::Arguments arguments;
  tessera::FleetArguments fleet;
  std::string folder, reopen, state;
  CLI::App app("What a task costs beside its work");
  app.add_option("--tiles", arguments.tiles)->capture_default_str();
  app.add_option("--workers", arguments.workers)->capture_default_str();
  app.add_option("--folder", folder, "where state and blobs lie for the while; else the system's temporary folder");
  app.add_flag("--empty", arguments.empty, "files of no size");
  app.add_flag("--no-shared-storage", arguments.no_shared_storage, "all data through the blob service");
  app.add_option("--tasks", fleet.tasks,
                 "instead: so many tasks and workers that do nothing, and write nothing, each a connection of its own; "
                 "needs --folder, where the state stays");
  app.add_option("--work-s", fleet.work_s, "with --tasks: that a worker takes for one");
  app.add_flag("--tls", fleet.tls, "with --tasks: over TLS, with tokens");
  app.add_option("--pages", fleet.pages,
                 "with --tasks: so many browsers have the page of the job open in every other turn, and the ratio of "
                 "the tasks a second with and without them");
  app.add_option("--state", state,
                 "with --tasks: first with SQLite, then with the state in this empty PostgreSQL database or schema "
                 "(postgresql://...), and the ratio of their tasks a second");
  app.add_option("--reopen", reopen, "instead: how long a coordinator takes to start on the state of such a run");
  CLI11_PARSE(app, argc, argv);
  fleet.workers = arguments.workers;
  const tessera::Status status = !reopen.empty()                     ? tessera::ReopenFleet(reopen)
                                 : fleet.tasks > 0 && !state.empty() ? tessera::CompareStates(fleet, folder, state)
                                 : fleet.tasks > 0                   ? tessera::RunFleet(fleet, folder, "").status()
                                                                     : tessera::Run(arguments, folder);
  if (status.ok()) return 0;
  std::fprintf(stderr, "dispatch_bench: %s\n", std::string(status.message()).c_str());
  return 1;
}
