// Random faults of all kinds on the real executables, for a given time: no job or result may be lost.
#include <gtest/gtest.h>
#include <sched.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <random>

#include "common/storage/files.h"
#include "tests/e2e/namespaces.h"
#include "tests/soak/faults.h"
#include "tests/soak/own_servers.h"
#include "tests/soak/server_storage.h"
#include "tests/soak/soaked_jobs.h"
#include "tests/support/servers/test_server.h"

namespace tessera::soak {
namespace {

namespace fs = std::filesystem;

constexpr int kSkipped = 77;  // exit code; CMakeLists.txt has it, too

struct Flags {
  double minutes = 1;
  uint64_t seed = 0;
  std::string out;
  int workers = 3;
  double round_s = 30;
  double end_s = 240;
  bool servers = false;
};

class Progress {
 public:
  explicit Progress(double all_s) : all_s_(all_s), every_s_(::isatty(STDERR_FILENO) != 0 ? 0.5 : 15) {}
  void Show(const History& history, int round, const Tally& tally) {
    const double now_s = history.Now_s();
    if (now_s < next_s_) return;
    next_s_ = now_s + every_s_;
    int faults = 0, jobs = 0;
    for (const auto& [kind, count] : tally.faults) faults += count;
    for (const auto& [state, count] : tally.jobs) jobs += count;
    std::fprintf(stderr, "%s%.0f of %.0f s, cluster %d, %d faults, %d jobs ended, %.1f MB compared, %.0f s to go%s",
                 every_s_ < 1 ? "\r" : "", now_s, all_s_, round, faults, jobs, static_cast<double>(tally.bytes) / 1e6,
                 std::max(0.0, all_s_ - now_s), every_s_ < 1 ? "   " : "\n");
  }

 private:
  const double all_s_, every_s_;
  double next_s_ = 0;
};

void PrintCounts(const char* title, const std::map<std::string, int>& counts) {
  std::printf("%s\n", title);
  for (const auto& [what, count] : counts) std::printf("  %-28s %6d\n", what.c_str(), count);
}

void Print(const Tally& tally, const History& history) {
  PrintCounts("faults", tally.faults);
  PrintCounts("commands", tally.commands);
  PrintCounts("jobs by how they ended", tally.jobs);
  PrintCounts("attempts that failed", tally.failures);
  std::printf(
      "%d files, %lld bytes compared with those of undisturbed jobs\n%d records read, %d lists of jobs looked through\n"
      "longest wait for all jobs after the last fault: %.1f s; for `tessera jobs`: %.1f s\n"
      "%d starts of the coordinator were refused; %d times it had lost its right to write\n%.0f s in all\n",
      tally.files, static_cast<long long>(tally.bytes), tally.records, tally.answers, tally.longest_end_s,
      tally.longest_answer_s, tally.refused_starts, tally.replacements, history.Now_s());
}

// A cluster from its start to its end.
class Round {
 public:
  // `storage`: null if state and blobs are in the coordinator's folder.
  Round(const std::string& folder, const Flags& flags, bool disks, ServerStorage* storage, uint64_t seed,
        History& history, Tally& tally)
      : flags_(flags),
        seed_(seed),
        history_(history),
        tally_(tally),
        cluster_(folder, flags.workers, disks, storage, seed, history),
        faults_(cluster_, disks, seed, history, tally.faults),
        jobs_(cluster_, seed, history, tally) {}

  // Faults happen for `for_s` at most.
  void Run(double for_s, const std::function<void()>& look) {
    Random random = RandomOf(seed_, 'r', 0), fault_pauses = RandomOf(seed_, 'r', 1),
           act_pauses = RandomOf(seed_, 'r', 2);
    const double until_s = history_.Now_s() + std::min(for_s, random.Uniform(0.5, 1.5) * flags_.round_s);
    double fault_s = history_.Now_s() + 1, act_s = 0;
    while (history_.Now_s() < until_s) {
      if (history_.Now_s() >= act_s) {
        jobs_.Act();
        act_s = history_.Now_s() + act_pauses.Uniform(0.1, 1.5);
      }
      if (history_.Now_s() >= fault_s) {
        faults_.Strike();
        fault_s = history_.Now_s() + fault_pauses.Uniform(0.1, 1.5);
      }
      faults_.Lift();
      Supervise(look);
    }
    faults_.LiftAll();
    history_.Note("no faults any more");
    const double lifted_s = history_.Now_s();
    while (!jobs_.BringToEnd()) {
      Supervise(look);
      if (history_.Now_s() - lifted_s < flags_.end_s) continue;
      throw Violation("not all jobs ended within " + std::to_string(static_cast<int>(flags_.end_s)) +
                      " s of the last fault:" + jobs_.Waiting());
    }
    tally_.longest_end_s = std::max(tally_.longest_end_s, history_.Now_s() - lifted_s);
    jobs_.Compare();
    cluster_.Finish();
    tally_.refused_starts += cluster_.refused_starts();
    tally_.replacements += cluster_.replacements();
    ServerStorage* const storage = cluster_.storage();
    jobs_.CheckRecords(e2e::AuditRecords(storage != nullptr ? storage->state() : cluster_.data() + "/state.sqlite"));
  }
  // What is left of the state, for who looks for a fault: file systems in memory go with this process.
  void KeepState(const std::string& to) {
    if (cluster_.storage() != nullptr) return cluster_.storage()->Dump(to);
    for (const char* name : {"state.sqlite", "state.sqlite-wal"}) {
      std::error_code ignored;
      fs::copy_file(cluster_.data() + "/" + name, to + "/" + name, ignored);
    }
  }

 private:
  void Supervise(const std::function<void()>& look) {
    cluster_.Supervise();
    jobs_.Supervise();
    look();
    ::usleep(10'000);
  }

  const Flags& flags_;
  const uint64_t seed_;
  History& history_;
  Tally& tally_;
  SoakedCluster cluster_;
  Faults faults_;
  SoakedJobs jobs_;
};

// One cluster, from its start to its end. Whether all held.
bool SoakCluster(int number, const std::string& folder, const Flags& flags, bool disks, OwnServers* servers,
                 double left_s, History& history, Tally& tally, Progress& progress) {
  fs::create_directories(folder);
  history.Note("cluster " + std::to_string(number));
  std::unique_ptr<ServerStorage> storage;
  std::unique_ptr<Round> round;
  try {
    if (servers != nullptr) storage = std::make_unique<ServerStorage>(*servers, folder, number);
    round = std::make_unique<Round>(folder, flags, disks, storage.get(),
                                    MixBits(flags.seed) + static_cast<uint64_t>(number), history, tally);
    round->Run(left_s, [&] { progress.Show(history, number, tally); });
    return true;
  } catch (const std::exception& error) {
    Print(tally, history);
    std::printf("VIOLATION with seed %llu, cluster %d, step %d: %s\nbefore it:\n",
                static_cast<unsigned long long>(flags.seed), number, history.steps(), error.what());
    for (const std::string& line : history.last()) std::printf("  %s\n", line.c_str());
    std::printf("kept: %s\n", folder.c_str());
    std::fflush(stdout);
  }
  try {
    if (round != nullptr) round->KeepState(folder);
  } catch (const std::exception& error) {
    std::printf("the state is not kept: %s\n", error.what());
  }
  return false;
}

int Soak(Flags flags) {
  std::printf("seed %llu, %.1f minutes\n", static_cast<unsigned long long>(flags.seed), flags.minutes);
  if (flags.out.empty()) flags.out = fs::temp_directory_path() / ("cluster_soak-" + std::to_string(::getpid()));
  fs::create_directories(flags.out);
  std::unique_ptr<OwnServers> servers;
  if (flags.servers) {
    servers = std::make_unique<OwnServers>(flags.out + "/servers");
    if (!servers->missing().empty()) {
      std::printf("%s\n", servers->missing().c_str());
      return ServersAreRequired() ? 1 : kSkipped;
    }
  }
  // In a user namespace, PostgreSQL could not be started again: it needs a second user.
  const Status own_mounts = flags.servers && ::geteuid() != 0
                                ? absl::FailedPreconditionError("--servers needs root for that")
                                : e2e::EnterNamespaces(CLONE_NEWNS);
  if (!own_mounts.ok()) {
    std::printf("no full disks: %s\n", std::string(own_mounts.message()).c_str());
  }
  std::printf("logs in %s\n", flags.out.c_str());
  std::fflush(stdout);
  // Their results too are made when they are first needed.
  for (const Errand& errand : Errands()) errand.scene();
  History history(flags.out + "/history.log");
  Tally tally;
  const double all_s = 60 * flags.minutes;
  Progress progress(all_s);
  for (int number = 1; number == 1 || history.Now_s() < all_s; ++number) {
    const std::string folder = flags.out + "/" + std::to_string(number);
    const double left_s = std::max(1.0, all_s - history.Now_s());
    if (!SoakCluster(number, folder, flags, own_mounts.ok(), servers.get(), left_s, history, tally, progress)) return 1;
    fs::remove_all(folder);
  }
  Print(tally, history);
  std::printf("no violation\n");
  return 0;
}

}  // namespace
}  // namespace tessera::soak

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  testing::GTEST_FLAG(throw_on_failure) = true;  // what the helpers of tests expect
  tessera::soak::Flags flags;
  flags.seed = std::random_device()();
  CLI::App app("Lets faults happen to a coordinator and workers by chance, and checks that nothing is lost");
  app.add_option("--minutes", flags.minutes, "how long faults happen; then all jobs come to their end")
      ->capture_default_str();
  app.add_option("--seed", flags.seed, "of what happens; without it another every time");
  app.add_option("--out", flags.out, "folder for logs; else one in the system's temporary folder");
  app.add_option("--workers", flags.workers)->check(CLI::Range(1, 16))->capture_default_str();
  app.add_option("--round-s", flags.round_s, "of faults, for one cluster, on average")->capture_default_str();
  app.add_flag("--servers", flags.servers,
               "state in PostgreSQL and blobs in an S3 store, which are started for this and have faults, too");
  app.add_option("--end-s", flags.end_s, "in which all jobs must end once there are no faults any more")
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    return tessera::soak::Soak(flags);
  } catch (const std::exception& error) {
    std::printf("the soak itself failed: %s\n", error.what());
    return 1;
  }
}
