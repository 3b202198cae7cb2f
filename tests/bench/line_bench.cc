// line_bench SCENE WORK_DIR TILES [ROUNDS]: runs a job in this process and prints what each task took and did. With
// --cores it predicts what tasks would take on that many cores: see loop_recorder.h.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/loops/loop_recorder.h"
#include "common/base/parallel.h"
#include "tests/support/in_process_line.h"

namespace tessera {
namespace {

constexpr double kLoop_s = 5e-6;  // what starting a loop on several threads takes

// Seconds of tasks, or of parts of them, on one core and predicted on many.
struct Seconds {
  int64_t count = 0;
  double one_core = 0, many_cores = 0, outside_loops = 0;
};

// Of the loops that are not within others, by name, and of what runs before each.
using LoopSeconds = std::map<std::string, Seconds>;

struct KindSeconds {
  Seconds all;
  LoopSeconds loops;
};

void Add(const WorkRecord& work, int cores, KindSeconds* kind) {
  ++kind->all.count;
  kind->all.one_core += work.TotalSeconds();
  kind->all.many_cores += PredictedSeconds(work, cores, kLoop_s);
  kind->all.outside_loops += work.seconds;
  double after_last = work.seconds;
  const auto add = [&](const std::string& name, double one_core, double many_cores) {
    Seconds& row = kind->loops[name];
    ++row.count;
    row.one_core += one_core;
    row.many_cores += many_cores;
  };
  for (const LoopRecord& loop : work.loops) {
    const std::string name = loop.Name();
    add(name, loop.TotalSeconds(), PredictedSeconds(loop, cores, kLoop_s));
    add("before " + name, loop.seconds_before, loop.seconds_before);
    after_last -= loop.seconds_before;
  }
  add("after the last loop", after_last, after_last);
}

void Print(const std::map<std::string, KindSeconds>& kinds, int cores, size_t loops) {
  std::printf("%-10s %6s %12s %10s %9s %16s\n", "kind", "tasks", "one core, s", "cores, s", "speed-up",
              "outside loops, s");
  Seconds total;
  const auto row = [](const std::string& name, const Seconds& s) {
    std::printf("%-10s %6lld %12.2f %10.2f %9.1f %16.2f\n", name.c_str(), static_cast<long long>(s.count), s.one_core,
                s.many_cores, s.one_core / std::max(s.many_cores, 1e-9), s.outside_loops);
  };
  for (const auto& [name, kind] : kinds) {
    row(name, kind.all);
    total.count += kind.all.count;
    total.one_core += kind.all.one_core;
    total.many_cores += kind.all.many_cores;
    total.outside_loops += kind.all.outside_loops;
  }
  row("all", total);
  for (const auto& [name, kind] : kinds) {
    std::vector<std::pair<std::string, Seconds>> rows(kind.loops.begin(), kind.loops.end());
    const auto lost = [&](const Seconds& s) { return s.many_cores - s.one_core / cores; };
    std::sort(rows.begin(), rows.end(), [&](const auto& a, const auto& b) { return lost(a.second) > lost(b.second); });
    if (loops > 0) std::printf("\n%s: lost s, one core s, cores s, loops\n", name.c_str());
    for (size_t i = 0; i < std::min(loops, rows.size()); ++i) {
      const Seconds& s = rows[i].second;
      std::printf("%8.3f %8.3f %8.3f %7lld  %s\n", lost(s), s.one_core, s.many_cores, static_cast<long long>(s.count),
                  rows[i].first.c_str());
    }
  }
}

int Main(int argc, char** argv) {
  CLI::App app("Runs a job in this process and prints what each task took and did.");
  std::string scene, folder;
  JobSettings settings;
  int cores = 0;
  size_t loops = 0;
  app.add_option("scene", scene, "folder of the scene")->required();
  app.add_option("folder", folder, "new folder for the tasks' files")->required();
  app.add_option("tiles", settings.tiles, "number of tiles")->required();
  app.add_option("rounds", settings.rounds, "number of rounds");
  app.add_option("--cores", cores, "predict seconds on so many cores: all tasks run on one core");
  app.add_option("--loops", loops, "with --cores: so many loops of each kind, by the seconds that they lose");
  CLI11_PARSE(app, argc, argv);
  std::optional<ThreadLimit> limit;
  std::optional<LoopRecorder> recorder;
  if (cores > 0) {
    limit.emplace(cores);
    recorder.emplace();
  }
  std::map<std::string, KindSeconds> kinds;
  const auto run = [&](const TaskRequest& request) {
    if (recorder) recorder->Take();
    auto outcome = RunTask(request, TaskControl());
    if (recorder) Add(recorder->Take(), cores, &kinds[request.kind]);
    if (outcome.ok()) std::printf("%-8s %s\n", request.kind.c_str(), outcome->stats.c_str());
    std::fflush(stdout);
    return outcome;
  };
  const auto tasks = RunLine(scene, folder, settings, run);
  if (!tasks.ok()) {
    std::fprintf(stderr, "%s\n", std::string(tasks.status().message()).c_str());
    return 1;
  }
  std::printf("%s/mesh.ply\n", tasks->back().output_dir.c_str());
  if (recorder) Print(kinds, cores, loops);
  return 0;
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) { return tessera::Main(argc, argv); }
