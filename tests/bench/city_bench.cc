// A city that does not fit into memory, made, ingested, planned, cut, and published with cores that pass the cut
// through:
//   city_bench FOLDER --faces 100e6 [--tiles 100] [--limit-mib 2048]
// Each step is a process of its own; prints its seconds of CPU and its peak of anonymous memory, and at the end the
// result's SHA-256. --limit-mib sets RLIMIT_DATA, which the steps' private memory then cannot exceed; a memory cgroup
// around the program bounds the page cache too. Needs about 200 bytes of disk a face.
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <fstream>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/imaging/image_io.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/meshio/ply.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"
#include "server/plan/graph.h"
#include "worker/tasks/task.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {
namespace {

constexpr double kPitch_m = 0.3, kCameraHeight_m = 600;
constexpr double kCameraStepX_m = 400, kCameraStepY_m = 300;
constexpr int kWidth = 4000, kHeight = 3000;
constexpr double kFocal_px = 4000;  // GSD 0.15 m

// Hills, and blocks of houses with sloping sides; every sixteenth is so steep that its sides are split.
double Height(double x, double y, int* label) {
  const double ground = 4 * std::sin(x / 170) * std::cos(y / 230) + 0.3 * std::sin(x / 7) * std::sin(y / 9);
  const double u = std::fmod(x, 40), v = std::fmod(y, 40);
  const double inside = std::min(std::min(u - 8, 32 - u), std::min(v - 8, 32 - v));  // of the block's border
  *label = inside > 3 ? 2 : 0;
  if (inside <= 0) return ground;
  const auto block = static_cast<int>(x / 40) * 7 + static_cast<int>(y / 40) * 13;
  return ground + (block % 16 == 0 ? 36 : 5) * std::min(1.0, inside / 3);
}

Status MakeScene(const std::string& folder, int64_t faces) {
  const auto side = static_cast<int64_t>(std::lround(std::sqrt(static_cast<double>(faces) / 2)));
  for (const char* name : {"", "/colmap", "/images"}) TESSERA_RETURN_IF_ERROR(EnsureFolder(folder + name));
  TESSERA_RETURN_IF_ERROR(
      WriteFileAtomic(folder + "/scene.json",
                      R"({"tessera_scene": 1, "classes": ["ground", "facade", "roof"], "crs": {"type": "local"}})"));
  PlyLayout layout;
  layout.vertices = (side + 1) * (side + 1);
  layout.faces = 2 * side * side;
  layout.has_labels = true;
  TESSERA_ASSIGN_OR_RETURN(PlyStream mesh, PlyStream::Create(folder + "/mesh.ply", layout));
  int label = 0;
  for (int64_t y = 0; y <= side; ++y) {
    for (int64_t x = 0; x <= side; ++x) {
      const double px = kPitch_m * static_cast<double>(x), py = kPitch_m * static_cast<double>(y);
      mesh.AddVertex({px, py, Height(px, py, &label)});
    }
  }
  for (int64_t y = 0; y < side; ++y) {
    for (int64_t x = 0; x < side; ++x) {
      Height(kPitch_m * (static_cast<double>(x) + 0.5), kPitch_m * (static_cast<double>(y) + 0.5), &label);
      const auto a = static_cast<uint32_t>(y * (side + 1) + x), d = static_cast<uint32_t>(a + side + 1);
      mesh.AddFace({{a, a + 1, d + 1}, label});
      mesh.AddFace({{a, d + 1, d}, label});
    }
  }
  TESSERA_RETURN_IF_ERROR(mesh.Finish());

  const double extent_m = kPitch_m * static_cast<double>(side);
  std::string images;
  int views = 0;
  for (double y = kCameraStepY_m / 2; y - kCameraStepY_m / 2 < extent_m; y += kCameraStepY_m) {
    for (double x = kCameraStepX_m / 2; x - kCameraStepX_m / 2 < extent_m; x += kCameraStepX_m) {
      // Looks down, image x to the east: half a turn about x.
      const Eigen::Vector3d centre(std::min(x, extent_m), std::min(y, extent_m), kCameraHeight_m);
      absl::StrAppendFormat(&images, "%d 0 1 0 0 %.17g %.17g %.17g 1 view%d.png\n\n", views + 1, -centre.x(),
                            centre.y(), centre.z(), views);
      TESSERA_RETURN_IF_ERROR(
          WritePng(absl::StrCat(folder, "/images/view", views, ".png"), ByteImage(kWidth, kHeight)));
      ++views;
    }
  }
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/colmap/cameras.txt",
                                          absl::StrFormat("1 PINHOLE %d %d %g %g %g %g\n", kWidth, kHeight, kFocal_px,
                                                          kFocal_px, kWidth / 2.0, kHeight / 2.0)));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/colmap/points3D.txt", ""));
  return WriteFileAtomic(folder + "/colmap/images.txt", images);
}

StatusOr<TaskOutcome> RunInFolder(const std::string& kind, const std::string& parameters, const std::string& in,
                                  const std::string& out) {
  TESSERA_RETURN_IF_ERROR(EnsureFolder(out));
  TaskControl control;
  if (std::getenv("CITY_BENCH_VERBOSE") != nullptr) {
    control.report = [](double fraction, const std::string& stage) {
      std::fprintf(stderr, "%5.1f %% %s\n", 100 * fraction, stage.c_str());
    };
  }
  return RunTask({kind, parameters, in, out}, control);
}

Status Ingest(const std::string& folder) {
  TESSERA_ASSIGN_OR_RETURN(const TaskOutcome outcome,
                           RunInFolder("ingest", ToJson(IngestParameters()), folder, folder + "/city"));
  std::printf("  %s\n", outcome.stats.c_str());
  return absl::OkStatus();
}

StatusOr<std::vector<PlannedTask>> Plan(const std::string& folder, int tiles) {
  TESSERA_ASSIGN_OR_RETURN(const std::string survey, ReadFile(folder + "/city/" + kSurveyFile));
  Warnings warnings;
  TESSERA_ASSIGN_OR_RETURN(const SceneDescription scene, LoadScene(folder + "/scene", &warnings));
  return PlanTiles({.tiles = tiles}, survey, scene.files);
}

// The core as the tile has it, unrefined.
StatusOr<TileState> PassThrough(TilePackage package) {
  TileWorkspace tile(std::move(package));
  TESSERA_ASSIGN_OR_RETURN(TileSnapshot start, tile.Assemble({}, 0));
  start.confidence.assign(start.labels.size(), 1.0f);
  return tile.StateOf(start);
}

// The package goes once its core is there.
Status CutToCore(const std::string& folder, const PlannedTask& task, int tile) {
  const std::string out = absl::StrCat(folder, "/cut", tile);
  TESSERA_RETURN_IF_ERROR(RunInFolder("cut", task.parameters, folder + "/city", out).status());
  TESSERA_ASSIGN_OR_RETURN(TilePackage package, ReadTilePackage(absl::StrCat(out, "/", kTileFile)));
  TESSERA_ASSIGN_OR_RETURN(const TileState core, PassThrough(std::move(package)));
  const std::string path = absl::StrCat(folder, "/city/", TileInputName(tile, kStateFile));
  TESSERA_RETURN_IF_ERROR(EnsureFolder(path.substr(0, path.rfind('/'))));
  TESSERA_RETURN_IF_ERROR(WriteTileState(path, core));
  return RemoveTree(out);
}

Status Publish(const std::string& folder, const PlannedTask& task) {
  TESSERA_RETURN_IF_ERROR(RunInFolder("publish", task.parameters, folder + "/city", folder + "/out").status());
  TESSERA_ASSIGN_OR_RETURN(const Digest digest, HashFile(folder + "/out/" + kMeshFile));
  std::printf("  mesh.ply: %lld bytes, SHA-256 %s\n", static_cast<long long>(digest.size_bytes), digest.sha256.c_str());
  return absl::OkStatus();
}

double AnonymousMib() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    if (word == "RssAnon:" && status >> word) return std::stod(word) / 1024;
  }
  return 0;
}

struct Usage {
  double peak_anonymous_mib = 0, peak_resident_mib = 0, cpu_s = 0;
};

struct Step {
  std::string name;
  pid_t process = 0;
  int pipe_end = -1;
};

// Starts `step` in a process of its own.
Step StartStep(const std::string& name, int limit_mib, const std::function<Status()>& step) {
  int pipe_ends[2];
  if (pipe(pipe_ends) != 0) std::exit(1);
  std::fflush(stdout);
  const pid_t child = fork();
  if (child != 0) {
    close(pipe_ends[1]);
    return {name, child, pipe_ends[0]};
  }
  if (limit_mib > 0) {
    const rlimit limit = {static_cast<rlim_t>(limit_mib) << 20, static_cast<rlim_t>(limit_mib) << 20};
    setrlimit(RLIMIT_DATA, &limit);
  }
  std::atomic<bool> done = false;
  Usage usage;
  std::thread sampler([&] {
    while (!done) {
      usage.peak_anonymous_mib = std::max(usage.peak_anonymous_mib, AnonymousMib());
      usleep(20000);
    }
  });
  const Status status = step();
  done = true;
  sampler.join();
  rusage used;
  getrusage(RUSAGE_SELF, &used);
  usage.peak_resident_mib = static_cast<double>(used.ru_maxrss) / 1024;
  usage.cpu_s = static_cast<double>(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
                1e-6 * static_cast<double>(used.ru_utime.tv_usec + used.ru_stime.tv_usec);
  if (!status.ok()) std::fprintf(stderr, "%s: %s\n", name.c_str(), status.ToString().c_str());
  std::fflush(stdout);
  const bool told = write(pipe_ends[1], &usage, sizeof(usage)) == sizeof(usage);
  _exit(status.ok() && told ? 0 : 1);
}

// Waits for it; exits the program if it failed.
Usage FinishStep(const Step& step) {
  Usage usage;
  const bool told = read(step.pipe_end, &usage, sizeof(usage)) == sizeof(usage);
  close(step.pipe_end);
  int status = 0;
  waitpid(step.process, &status, 0);
  if (!told || status != 0) {
    std::fprintf(stderr, "%s failed%s\n", step.name.c_str(), WIFSIGNALED(status) ? " (killed)" : "");
    std::exit(1);
  }
  return usage;
}

Usage RunStep(const std::string& name, int limit_mib, const std::function<Status()>& step) {
  return FinishStep(StartStep(name, limit_mib, step));
}

void Print(const std::string& name, const Usage& usage) {
  std::printf("%-24s %8.1f s CPU %8.0f MiB anonymous at most %8.0f MiB resident with mapped files\n", name.c_str(),
              usage.cpu_s, usage.peak_anonymous_mib, usage.peak_resident_mib);
  std::fflush(stdout);
}

void Worst(const Usage& usage, Usage* worst) {
  worst->peak_anonymous_mib = std::max(worst->peak_anonymous_mib, usage.peak_anonymous_mib);
  worst->peak_resident_mib = std::max(worst->peak_resident_mib, usage.peak_resident_mib);
  worst->cpu_s += usage.cpu_s;
}

void Run(const std::string& folder, double faces, int tiles, int limit_mib, int jobs) {
  const std::string scene = folder + "/scene";
  if (!FileExists(scene + "/colmap/images.txt")) {
    Print("make", RunStep("make", 0, [&] { return MakeScene(scene, static_cast<int64_t>(faces)); }));
  }
  if (!FileExists(folder + "/city/" + kSurveyFile)) {
    Print("ingest", RunStep("ingest", limit_mib, [&] { return Ingest(folder); }));
  }
  Print("plan", RunStep("plan", limit_mib, [&] { return Plan(folder, tiles).status(); }));
  // Each step plans anew, for a plan of the whole city is part of no task.
  const auto plan_file = folder + "/tasks.txt";
  RunStep("list", 0, [&]() -> Status {
    TESSERA_ASSIGN_OR_RETURN(const std::vector<PlannedTask> tasks, Plan(folder, tiles));
    std::string lines;
    PublishParameters publish;
    for (const PlannedTask& task : tasks) {
      if (task.kind != kCutKind) continue;
      absl::StrAppend(&lines, task.kind.str(), " ", task.parameters, "\n");
      TESSERA_ASSIGN_OR_RETURN(const CutParameters cut, ParseCutParameters(task.parameters));
      publish.tiles.push_back(cut.tile);
    }
    absl::StrAppend(&lines, kPublishKind, " ", ToJson(publish), "\n");
    return WriteFileAtomic(plan_file, lines);
  });
  std::ifstream lines(plan_file);
  Usage cut;
  std::deque<Step> cutting;
  int count = 0, cut_now = 0;
  for (std::string kind, parameters; lines >> kind && std::getline(lines >> std::ws, parameters);) {
    PlannedTask task;
    task.parameters = parameters;
    if (kind == "cut") {
      const int tile = count++;
      if (FileExists(absl::StrCat(folder, "/city/", TileInputName(tile, kStateFile)))) continue;
      if (cutting.size() == static_cast<size_t>(jobs)) {
        Worst(FinishStep(cutting.front()), &cut);
        cutting.pop_front();
      }
      cutting.push_back(StartStep("cut", limit_mib, [&] { return CutToCore(folder, task, tile); }));
      ++cut_now;
    } else {
      for (const Step& step : cutting) Worst(FinishStep(step), &cut);
      Print(absl::StrCat("cut ", cut_now, " of ", count, " tiles"), cut);
      Print("publish", RunStep("publish", limit_mib, [&] { return Publish(folder, task); }));
    }
  }
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  CLI::App app("A city that does not fit into memory, ingested, cut and published");
  std::string folder;
  double faces = 5e6;
  int tiles = 0, limit_mib = 0, jobs = 1;
  app.add_option("folder", folder, "where everything goes; steps whose results are there are not repeated")->required();
  app.add_option("--faces", faces, "of the scene's mesh");
  app.add_option("--tiles", tiles, "0: as the plan wants");
  app.add_option("--limit-mib", limit_mib, "of private memory of each step; 0: none");
  app.add_option("--jobs", jobs, "tiles that are cut at a time")->check(CLI::PositiveNumber);
  CLI11_PARSE(app, argc, argv);
  tessera::Run(folder, faces, tiles, limit_mib, jobs);
  return 0;
}
