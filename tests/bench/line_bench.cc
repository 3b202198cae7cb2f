// line_bench SCENE WORK_DIR TILES [ROUNDS]: runs a job in this process and prints what each task took and did. With
// --cores it predicts what tasks would take on that many cores: see loop_recorder.h. With --workers it also predicts
// what the whole job would take on a machine with these cores.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/base/loops/loop_recorder.h"
#include "common/base/parallel.h"
#include "server/leases/thread_rule.h"
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

// A task of a job on one machine.
struct TimedTask {
  std::map<int, double> seconds;  // by cores
  std::vector<size_t> after;      // the tasks whose outputs or plan it needs
};

// The tasks that each task of the job waits for: those whose outputs it reads, and the cuts that its plan is made from.
std::vector<std::vector<size_t>> WaitsOf(const std::vector<LineTask>& tasks) {
  std::vector<std::vector<size_t>> waits(tasks.size());
  std::vector<size_t> cuts;
  for (size_t t = 0; t < tasks.size(); ++t) {
    const PlannedTask& planned = tasks[t].planned;
    if (planned.kind == kSplitKind) cuts.clear();
    if (planned.kind == kCutKind) {
      cuts.push_back(t);
    } else if (planned.kind != kCropKind) {
      waits[t] = cuts;
    }
    for (const PlannedInput& input : planned.inputs) waits[t].push_back(static_cast<size_t>(input.task.value()));
  }
  return waits;
}

// Seconds until all tasks are done on `workers` workers of one machine. A worker takes the first task that can run, on
// the cores that the coordinator would give it (ThreadsOfTask).
double JobSeconds(const std::vector<TimedTask>& tasks, int cores, int workers) {
  std::vector<size_t> waits_for(tasks.size());
  std::vector<std::vector<size_t>> before(tasks.size());
  std::set<size_t> ready;
  for (size_t t = 0; t < tasks.size(); ++t) {
    waits_for[t] = tasks[t].after.size();
    for (const size_t other : tasks[t].after) before[other].push_back(t);
    if (waits_for[t] == 0) ready.insert(t);
  }
  std::set<std::pair<double, size_t>> running;  // by the time of their ends
  double now = 0;
  while (true) {
    while (!ready.empty() && running.size() < static_cast<size_t>(workers)) {
      const MachineLoad load = {cores, workers, static_cast<int>(running.size()) + 1};
      const int threads = ThreadsOfTask(load, static_cast<int>(ready.size()) - 1, cores);
      const size_t task = *ready.begin();
      ready.erase(ready.begin());
      running.insert({now + tasks[task].seconds.at(threads), task});
    }
    if (running.empty()) return now;
    const auto [end, done] = *running.begin();
    running.erase(running.begin());
    now = end;
    for (const size_t next : before[done]) {
      if (--waits_for[next] == 0) ready.insert(next);
    }
  }
}

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
  std::vector<int> workers;
  app.add_option("scene", scene, "folder of the scene")->required();
  app.add_option("folder", folder, "new folder for the tasks' files")->required();
  app.add_option("tiles", settings.tiles, "number of tiles")->required();
  app.add_option("rounds", settings.rounds, "number of rounds");
  app.add_option("--cores", cores, "predict seconds on so many cores: all tasks run on one core");
  app.add_option("--loops", loops, "with --cores: so many loops of each kind, by the seconds that they lose");
  app.add_option("--workers", workers,
                 "with --cores: predict the job's seconds on so many workers, which share the cores; several numbers")
      ->delimiter(',')
      ->check(CLI::Range(1, 1024));
  CLI11_PARSE(app, argc, argv);
  if (cores <= 0 && !workers.empty()) {
    std::fprintf(stderr, "--workers: found no --cores; give it the cores of the machine\n");
    return 1;
  }
  const int most_workers = workers.empty() ? 0 : *std::max_element(workers.begin(), workers.end());
  std::vector<TimedTask> timed;
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
    if (recorder) {
      const WorkRecord work = recorder->Take();
      Add(work, cores, &kinds[request.kind]);
      TimedTask& task = timed.emplace_back();
      for (int tasks = 1; tasks <= most_workers; ++tasks) {
        const int threads = std::max(1, cores / tasks);
        if (task.seconds.count(threads) == 0) task.seconds[threads] = PredictedSeconds(work, threads, kLoop_s);
      }
    }
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
  const std::vector<std::vector<size_t>> waits = WaitsOf(*tasks);
  for (size_t t = 0; t < timed.size(); ++t) timed[t].after = waits[t];
  for (const int count : workers) {
    std::printf("%3d workers: %.2f s\n", count, JobSeconds(timed, cores, count));
  }
  return 0;
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) { return tessera::Main(argc, argv); }
