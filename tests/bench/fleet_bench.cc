// fleet_bench --folder DIR [--scene SCENE] [--tiles N]: pilots of `tessera fleet` on a Slurm of its own with two
// virtual nodes of one core. Prints the time from a job's submit to its first running task, beside that of `srun true`;
// the share of the pilots' core time that attempts of tasks take, from the first lease to the last report; and the
// number of submitted pilots beside the most that ran at once.
#include <signal.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "server/fleet/fleet_file.h"
#include "server/fleet/job_list.h"
#include "server/fleet/run_command.h"
#include "tests/bench/or_exit.h"
#include "tests/e2e/programs.h"

namespace tessera {
namespace {

double UnixSeconds(const google::protobuf::Timestamp& time) {
  return static_cast<double>(time.seconds()) + 1e-9 * time.nanos();
}

std::vector<v1::Attempt> AttemptsOf(Connection& connection, const std::string& job) {
  v1::ListAttemptsResponse listed;
  Check(connection.ListAttempts(job, &listed));
  return {listed.attempts().begin(), listed.attempts().end()};
}

std::string FleetText(const std::string& address, double interval_s, double worth_s) {
  const nlohmann::json json = {
      {"name", "bench"},
      {"scheduler", "slurm"},
      {"pilot", TESSERA_PILOT},
      {"worker", {TESSERA_WORKER_PROGRAM, "--coordinator", address}},
      {"interval_s", interval_s},
      {"worth_s", worth_s},
      {"classes", {{{"name", "node"}, {"memory", "3GiB"}, {"time_limit_s", 7200}, {"most", 2}}}}};
  return json.dump();
}

// Prints the figures of pilots that served these attempts.
void PrintPilots(const std::vector<Pilot>& pilots, const std::vector<v1::Attempt>& attempts) {
  double first_s = 1e18, last_s = 0, busy_s = 0, held_s = 0;
  for (const v1::Attempt& attempt : attempts) {
    first_s = std::min(first_s, UnixSeconds(attempt.start_time()));
    last_s = std::max(last_s, UnixSeconds(attempt.end_time()));
    busy_s += UnixSeconds(attempt.end_time()) - UnixSeconds(attempt.start_time());
  }
  std::vector<std::pair<double, int>> changes;  // of the number of pilots that run
  for (const Pilot& pilot : pilots) {
    if (pilot.started_s <= 0 || pilot.state == PilotState::kPending) continue;
    const double end_s = pilot.state == PilotState::kRunning ? last_s : pilot.ended_s;
    held_s += std::max(0.0, std::min(end_s, last_s) - std::max(pilot.started_s, first_s));
    changes.insert(changes.end(), {{pilot.started_s, 1}, {end_s, -1}});
  }
  std::sort(changes.begin(), changes.end());
  int now = 0, most = 0;
  for (const auto& [time_s, change] : changes) most = std::max(most, now += change);
  std::printf("core time of pilots: %.0f s, of which attempts take %.0f s: %.1f %%\n", held_s, busy_s,
              100 * busy_s / held_s);
  std::printf("pilots submitted: %zu, at most %d at once: %.2f\n", pilots.size(), most,
              static_cast<double>(pilots.size()) / most);
}

void Run(const std::string& folder, const std::string& scene, int tiles, double interval_s, double worth_s) {
  Check(EnsureFolder(folder));
  const std::string slurm = folder + "/slurm";
  e2e::Program(folder, TESSERA_START_SLURM, {slurm}).Wait();
  ::setenv("SLURM_CONF", (slurm + "/slurm.conf").c_str(), 1);
  {
    e2e::Cluster cluster(folder, 30);
    const std::string path = folder + "/fleet.json", text = FleetText(cluster.address(), interval_s, worth_s);
    std::ofstream(path) << text;
    FleetFile file = Value(ParseFleetFile(path, text));
    const double srun_s = Seconds([] {
      (void)Value(RunCommand({"srun", "--cpus-per-task=1", "--mem=100M", "true"}, {}));
    });
    e2e::Program fleet(folder, TESSERA_PROGRAM,
                       {"fleet", path, "--state", folder + "/state", "--coordinator", cluster.address()});
    // The job comes at any moment of an interval.
    e2e::WaitUntil([&] { return fleet.Output().find("fleet started") != std::string::npos; });
    ::usleep(static_cast<useconds_t>(1e6 * interval_s / 2));
    std::string job;
    const double first_task_s = Seconds([&] {
      job = cluster.Submit(scene, tiles).name();
      e2e::WaitUntil([&] { return !AttemptsOf(cluster.connection(), job).empty(); });
    });
    std::printf("submit to first task: %.1f s, `srun true`: %.1f s, beyond it: %.1f s (interval %.0f s)\n",
                first_task_s, srun_s, first_task_s - srun_s, interval_s);
    std::fflush(stdout);
    v1::Job ended;
    e2e::WaitUntil([&] { return cluster.connection().GetJob(job, &ended).ok() && ended.has_end_time(); }, 1e5);
    const std::string listed = Value(RunCommand(ListWords(file, absl::StrCat(::geteuid())), {}));
    PrintPilots(Value(ParseSlurmJobs(listed, file, ::geteuid())), AttemptsOf(cluster.connection(), job));
    fleet.Signal(SIGTERM);
    fleet.Wait();
  }
  e2e::Program(folder, TESSERA_START_SLURM, {slurm, "stop"}).Wait();
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  std::string folder, scene;
  int tiles = 4;
  double interval_s = 10, worth_s = 300;
  CLI::App app("Pilots of tessera fleet on a Slurm with two virtual nodes of one core");
  app.add_option("--folder", folder, "for Slurm, the coordinator and logs; stays")->required();
  app.add_option("--scene", scene, "of the job")->required();
  app.add_option("--tiles", tiles)->capture_default_str();
  app.add_option("--interval-s", interval_s, "of the fleet")->capture_default_str();
  app.add_option("--worth-s", worth_s, "of the fleet: work that each pilot should have")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  tessera::Run(tessera::AbsolutePath(folder), tessera::AbsolutePath(scene), tiles, interval_s, worth_s);
  return 0;
}
