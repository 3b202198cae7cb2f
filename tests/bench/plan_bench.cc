// plan_bench [--images 10000] [--faces 100e6] [--tile-memory 4GiB]: what the plan of a large city costs the
// coordinator. Makes a survey, gives a coordinator without network (coordinator core, SQLite store, blob store) a job
// of that many files, plays the workers to the job's end, phase after phase, and prints peak memory and seconds a
// stage. Tiles read those that lie as near as the reach of the operators. The survey is made by a process of its own,
// so that its memory does not count.
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <set>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/task_usage.h"
#include "common/job/task_kinds.h"
#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "server/jobs/coordinator.h"
#include "server/store/sqlite_store.h"
#include "tests/bench/synthetic_survey.h"
#include "tests/support/blocking_calls.h"

namespace tessera {
namespace {

void Print(const char* stage, const TaskUsageMeter& meter) {
  const TaskUsage usage = meter.Read();
  std::printf("%-28s %8.1f MiB peak  %8.2f core-seconds\n", stage, static_cast<double>(usage.peak_bytes) / (1 << 20),
              usage.core_seconds);
  std::fflush(stdout);
}

// Stores the survey in the blob store of `folder`; its digest goes to stdout of nobody: into `digest_file`.
int WriteSurvey(const SyntheticCity& city, const std::string& folder, const std::string& digest_file) {
  const auto blobs = FolderBlobs::Open(folder + "/blobs");
  if (!blobs.ok()) return 1;
  const Survey survey = MakeSyntheticSurvey(city);
  const std::string json = SurveyToJson(survey);
  const auto digest = (*blobs)->PutBytes(json);
  std::printf("%zu images, %.1f million faces, %zu cells, %zu pairs, survey of %.1f MiB\n", survey.views.size(),
              1e-6 * static_cast<double>(survey.faces), survey.cells.size(), survey.pairs.size(),
              static_cast<double>(json.size()) / (1 << 20));
  std::fflush(stdout);
  return digest.ok() && WriteFileAtomic(digest_file, digest->sha256 + " " + std::to_string(digest->size_bytes)).ok()
             ? 0
             : 1;
}

constexpr double kNearGsd = 250, kSolveNearGsd = 160;  // of tiles that read each other

// What the cut of a tile says that it reads.
std::string ReadsOf(const CutParameters& cut, double cell_m, double gsd_m) {
  const auto within = [&](double gsd) {
    std::vector<int> ids;
    for (int tile = 0; tile < static_cast<int>(cut.cores.size()); ++tile) {
      if (DistanceBetween(cut.cores[tile], cut.tile.core, cell_m) <= gsd * gsd_m) ids.push_back(tile);
    }
    return ids;
  };
  const std::vector<int> near = within(kNearGsd);
  return ToJson(TileReads{near, near, near, within(kSolveNearGsd)});
}

Status Run(const SyntheticCity& city, JobSettings settings) {
  TESSERA_ASSIGN_OR_RETURN(const TempFolder folder, TempFolder::Create("", "plan_bench-"));
  const std::string digest_file = folder.path() + "/survey";
  const pid_t child = fork();
  if (child == 0) _exit(WriteSurvey(city, folder.path(), digest_file));
  int wait_status = 0;
  if (child < 0 || waitpid(child, &wait_status, 0) != child || wait_status != 0) {
    return absl::InternalError("the survey could not be made");
  }
  TESSERA_ASSIGN_OR_RETURN(const std::string words, ReadFile(digest_file));
  const Digest survey = {words.substr(0, 64), std::stoll(words.substr(65))};

  const TaskUsageMeter meter;
  SystemClock clock;
  Planner planner;
  TESSERA_ASSIGN_OR_RETURN(const auto store, SqliteStore::Open(folder.path() + "/state.sqlite"));
  TESSERA_ASSIGN_OR_RETURN(const auto blobs, FolderBlobs::Open(folder.path() + "/blobs"));
  TESSERA_ASSIGN_OR_RETURN(
      const auto coordinator,
      Coordinator::Open({store.get(), blobs.get(), &planner, &clock, /*on_change=*/{}}, DispatchOptions()));
  TESSERA_ASSIGN_OR_RETURN(const Digest nothing, blobs->PutBytes(""));
  double cell_m = 0;
  NewJob job;
  job.scene_path = "/scene";
  job.settings = settings;
  {
    SyntheticCity few = city;
    few.faces = 1;
    const Survey small = MakeSyntheticSurvey(few);
    cell_m = small.ground.cell_m;
    for (const SceneView& view : small.views) {
      job.scene_files.push_back({view.image_path, nothing});
      job.scene_files.push_back({view.likelihood_path, nothing});
    }
  }
  TESSERA_ASSIGN_OR_RETURN(const JobStatus accepted, coordinator->jobs().CreateJob(job));
  job = NewJob();
  Print("job accepted", meter);
  TESSERA_ASSIGN_OR_RETURN(const std::string worker,
                           coordinator->leases().RegisterWorker({"host", 1, 2, int64_t{1} << 34}));
  std::set<std::string> told;
  size_t tasks = 0, inputs = 0;
  double cost = 0;
  while (true) {
    TESSERA_ASSIGN_OR_RETURN(const auto lease, LeaseAndWait(*coordinator, worker, 0, {}));
    if (!lease) break;
    ++tasks;
    inputs += lease->inputs.size();
    cost += lease->plan.cost;
    ReportedResult result;
    const std::string& kind = lease->plan.kind;
    const auto add = [&](const char* name, const Digest& digest) { result.outputs.push_back({name, digest}); };
    if (kind == kInspectKind) {
      add(kInspectionFile, nothing);
    } else if (kind == "ingest") {
      add(kCityFile, nothing);
      add(kSurveyFile, survey);
      add(kPlainSurveyFile, nothing);
    } else if (kind == "publish") {
      add(kMeshFile, nothing);
      add(kReportFile, nothing);
    } else if (kind == "cut") {
      TESSERA_ASSIGN_OR_RETURN(const CutParameters cut, ParseCutParameters(lease->plan.parameters));
      TESSERA_ASSIGN_OR_RETURN(const Digest reads, blobs->PutBytes(ReadsOf(cut, cell_m, city.gsd_m)));
      add(kTileFile, nothing);
      add(kReadsFile, reads);
    } else {
      add(kind == "crop" ? kViewsFile : kind == "measure" ? kSumsFile : kStateFile, nothing);
    }
    TESSERA_RETURN_IF_ERROR(ReportSuccessAndWait(*coordinator, worker, lease->task, lease->attempt, result));
    if (kind == "ingest") Print("planned", meter);
    if (kind != "ingest" && told.insert(kind).second) Print(("first " + kind).c_str(), meter);
  }
  const auto status = coordinator->jobs().GetJob(accepted.header.name);
  if (!status.ok() || status->header.state != JobState::kSucceeded) {
    return absl::InternalError("the job did not succeed: " +
                               (status.ok() ? status->header.error + status->waiting_for : ""));
  }
  Print("ended", meter);
  std::printf("%zu tasks, %zu inputs, %.0f core-seconds of work\n", tasks, inputs, cost);
  return absl::OkStatus();
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  tessera::SyntheticCity city;
  tessera::JobSettings settings;
  CLI::App app("What the plan of a large city costs the coordinator");
  app.add_option("--images", city.images, "Number of images")->capture_default_str();
  app.add_option("--faces", city.faces, "Number of faces")->capture_default_str();
  app.add_option("--tiles", settings.tiles, "Number of tiles; 0: as many as fit")->capture_default_str();
  std::string survey_file;
  app.add_option("--survey", survey_file, "Only write the survey to this file, for `tessera plan --survey`");
  CLI11_PARSE(app, argc, argv);
  if (!survey_file.empty()) {
    const std::string json = tessera::SurveyToJson(tessera::MakeSyntheticSurvey(city));
    return tessera::WriteFileAtomic(survey_file, json).ok() ? 0 : 1;
  }
  const tessera::Status status = tessera::Run(city, settings);
  if (status.ok()) return 0;
  std::fprintf(stderr, "plan_bench: %s\n", std::string(status.message()).c_str());
  return 1;
}
