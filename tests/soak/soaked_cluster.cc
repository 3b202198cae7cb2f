#include "tests/soak/soaked_cluster.h"

#include <signal.h>

#include <algorithm>
#include <filesystem>
#include <limits>

#include "tests/e2e/free_address.h"
#include "tests/e2e/namespaces.h"

namespace tessera::soak {
namespace {

constexpr int64_t kDisk_bytes = int64_t{1} << 30;
constexpr double kStart_s = 240;  // that a coordinator may take to start while nothing is harmed
constexpr double kEnd_s = 60;     // that a program may take to end
constexpr double kAgain_s = 0.5;  // after a start that was refused
constexpr char kReplacedExit[] = "exit code 75";

}  // namespace

void SoakedCluster::MountOn(const std::string& folder) {
  if (const Status mounted = e2e::MountMemory(folder, kDisk_bytes); !mounted.ok()) {
    throw std::runtime_error(mounted.ToString());
  }
}

SoakedCluster::SoakedCluster(const std::string& folder, int workers, bool disks, ServerStorage* storage, uint64_t seed,
                             History& history)
    : folder_(folder),
      data_(folder + "/data"),
      port_file_(folder + "/address"),
      address_(e2e::FreeAddress()),
      disks_(disks),
      storage_(storage),
      seed_(seed),
      history_(history) {
  if (disks_) {
    MountOn(data_);
    MountOn(data_ + "/blobs");
  }
  StartCoordinator();
  if (!e2e::WaitUntil([&] {
        SuperviseCoordinator();
        return !starting_;
      })) {
    throw Violation("the coordinator does not start:\n" + coordinator_->Output());
  }
  workers_.resize(workers);
  for (int i = 0; i < workers; ++i) {
    Worker& worker = workers_[i];
    worker.network = std::make_unique<e2e::TcpProxy>(address_);
    worker.scratch = folder_ + "/scratch-" + std::to_string(i);
    if (disks_) MountOn(worker.scratch);
    StartWorker(worker);
  }
}

SoakedCluster::~SoakedCluster() {
  coordinator_.reset();
  for (Worker& worker : workers_) worker.program.reset();
  if (!disks_) return;
  for (const Worker& worker : workers_) e2e::Unmount(worker.scratch).IgnoreError();
  e2e::Unmount(data_ + "/blobs").IgnoreError();
  e2e::Unmount(data_).IgnoreError();
}

void SoakedCluster::StartWorker(Worker& worker) {
  worker.shared = RandomOf(seed_, 'w', starts_++).Below(2) == 0;
  std::vector<std::string> arguments = {"--threads", "1",           "--coordinator", worker.network->address(),
                                        "--work",    worker.scratch};
  if (!worker.shared) arguments.push_back("--no-shared-storage");
  worker.program = std::make_unique<e2e::Program>(folder_, TESSERA_WORKER_PROGRAM, arguments);
  worker.end = worker.scratch_harmed ? End::kRefuses : End::kNone;
}

void SoakedCluster::StartCoordinator() {
  std::filesystem::remove(port_file_);
  std::vector<std::string> arguments = {"--listen", address_, "--port-file", port_file_,  "--scene-root",
                                        "/",        "--data", data_,         "--lease-s", std::to_string(kLease_s)};
  const auto start = [&] { coordinator_ = std::make_unique<e2e::Program>(folder_, TESSERAD_PROGRAM, arguments); };
  coordinator_ = nullptr;
  coordinator_end_ = End::kNone;
  starting_ = true;
  start_harmed_ = harms_of_state_ > 0;
  starting_since_s_ = history_.Now_s();
  if (storage_ == nullptr) return start();
  const std::vector<std::string> more = storage_->CoordinatorArguments();
  arguments.insert(arguments.end(), more.begin(), more.end());
  storage_->WithCredentials(start);
}

void SoakedCluster::AddHarmOfState(int change) {
  harms_of_state_ += change;
  if (change > 0) start_harmed_ = true;
  starting_since_s_ = history_.Now_s();
}

void SoakedCluster::SetDatabaseAway(bool away) {
  database_away_ = away;
  if (!away) calm_since_s_ = std::max(calm_since_s_, history_.Now_s());
}

void SoakedCluster::HarmScratch(int index, bool harmed) {
  Worker& worker = workers_[index];
  worker.scratch_harmed = harmed;
  // It may be about to start.
  if (harmed && worker.end == End::kNone) worker.end = End::kRefuses;
}

namespace {

bool IsAsExpected(End end, e2e::Program& program) {
  const std::string how = program.ExitDescription();
  switch (end) {
    case End::kKilled:
      return how == "signal 9 (Killed)";
    case End::kDrains:
      // A signal that comes before it is waited for ends the program as any other.
      return how == "exit code 0" || (how == "signal 15 (Terminated)" && program.Output().empty());
    case End::kRefuses:
      return how == "exit code 1";
    case End::kReplaced:
      return how == kReplacedExit;
    case End::kNone:
      return false;
  }
  return false;
}

}  // namespace

void SoakedCluster::Supervise() {
  const double now_s = history_.Now_s();
  for (Worker& worker : workers_) {
    if (worker.program->Running()) continue;
    if (!IsAsExpected(worker.end, *worker.program)) {
      throw Violation("a worker ended with " + worker.program->ExitDescription() + ", which nobody asked it to:\n" +
                      worker.program->Output());
    }
    if (now_s < worker.start_s) continue;
    if (worker.end == End::kRefuses) {
      ++refused_starts_;
      worker.start_s = now_s + kAgain_s;
    }
    StartWorker(worker);
    ++restarts_;
  }
  SuperviseCoordinator();
}

void SoakedCluster::SuperviseCoordinator() {
  const double now_s = history_.Now_s();
  if (coordinator_->Running()) {
    if (!starting_) return;
    if (std::filesystem::exists(port_file_)) {
      starting_ = false;
      calm_since_s_ = now_s;
    } else if (harms_of_state_ == 0 && !coordinator_stopped_ && now_s - starting_since_s_ > kStart_s) {
      throw Violation("the coordinator does not start again:\n" + coordinator_->Output());
    }
    return;
  }
  calm_since_s_ = std::numeric_limits<double>::infinity();
  TakeCoordinatorEnd();
  if (now_s < coordinator_start_s_) return;
  StartCoordinator();
  ++restarts_;
}

void SoakedCluster::TakeCoordinatorEnd() {
  if (IsAsExpected(coordinator_end_, *coordinator_)) return;
  const std::string how = coordinator_->ExitDescription();
  if (storage_ != nullptr && how == kReplacedExit) {
    history_.Note("the coordinator has lost its right to write the state");
    coordinator_end_ = End::kReplaced;
    coordinator_start_s_ = history_.Now_s();
    ++replacements_;
  } else if (starting_ && start_harmed_ && how == "exit code 1") {
    history_.Note("the coordinator cannot start");
    coordinator_end_ = End::kRefuses;
    coordinator_start_s_ = history_.Now_s() + kAgain_s;
    ++refused_starts_;
  } else {
    throw Violation("the coordinator ended with " + how + (starting_ ? " at its start" : "") +
                    ", which nobody asked it to:\n" + coordinator_->Output());
  }
}

double SoakedCluster::CalmSince_s() {
  const bool calm = !coordinator_stopped_ && !database_away_ && !starting_ && coordinator_end_ == End::kNone &&
                    coordinator_->Running();
  return calm ? calm_since_s_ : std::numeric_limits<double>::infinity();
}

bool SoakedCluster::EndWorker(int index, bool kill, double back_s) {
  Worker& worker = workers_[index];
  if (!worker.program->Running() || worker.end == End::kDrains) return false;
  worker.end = kill ? End::kKilled : End::kDrains;
  worker.start_s = history_.Now_s() + back_s;
  if (kill) {
    worker.program->Kill();
  } else {
    worker.program->Signal(SIGTERM);
  }
  return true;
}

void SoakedCluster::StopWorker(int index, bool stop) {
  workers_[index].stopped = stop;
  workers_[index].program->Signal(stop ? SIGSTOP : SIGCONT);
}

bool SoakedCluster::EndCoordinator(bool kill, double back_s) {
  if (!coordinator_->Running() || coordinator_end_ != End::kNone) return false;
  coordinator_end_ = kill ? End::kKilled : End::kDrains;
  coordinator_start_s_ = history_.Now_s() + back_s;
  if (kill) {
    coordinator_->Kill();
  } else {
    coordinator_->Signal(SIGTERM);
  }
  return true;
}

void SoakedCluster::StopCoordinator(bool stop) {
  coordinator_stopped_ = stop;
  if (!stop) calm_since_s_ = history_.Now_s();
  coordinator_->Signal(stop ? SIGSTOP : SIGCONT);
}

void SoakedCluster::LiftAll() {
  for (size_t i = 0; i < workers_.size(); ++i) {
    if (workers_[i].stopped) StopWorker(static_cast<int>(i), false);
    workers_[i].network->SetDelay(0);
    workers_[i].network->Set(e2e::TcpProxy::Mode::kPass);
    workers_[i].start_s = 0;
  }
  if (coordinator_stopped_) StopCoordinator(false);
  coordinator_start_s_ = 0;
}

void SoakedCluster::Finish() {
  // Those that were ended by the last faults are to be there again.
  const bool all_there = e2e::WaitUntil(
      [&] {
        Supervise();
        return !starting_ && coordinator_end_ == End::kNone && coordinator_->Running() &&
               std::all_of(workers_.begin(), workers_.end(), [](const Worker& worker) {
                 return worker.end != End::kDrains && worker.program->Running();
               });
      },
      kStart_s);
  if (!all_there) throw Violation("a program does not start again");
  for (Worker& worker : workers_) {
    if (worker.program->Running()) worker.program->Signal(SIGTERM);
    if (!e2e::WaitUntil([&] { return !worker.program->Running(); }, kEnd_s)) {
      throw Violation("a worker does not drain:\n" + worker.program->Output());
    }
    if (!IsAsExpected(End::kDrains, *worker.program)) {
      throw Violation("a worker that drains ended with " + worker.program->ExitDescription());
    }
  }
  coordinator_->Signal(SIGTERM);
  if (!e2e::WaitUntil([&] { return !coordinator_->Running(); }, kEnd_s)) {
    throw Violation("the coordinator does not end:\n" + coordinator_->Output());
  }
  // On servers, a machine without time for it may cost it its right.
  const std::string how = coordinator_->ExitDescription();
  if (how != "exit code 0" && (storage_ == nullptr || how != kReplacedExit)) {
    throw Violation("the coordinator ended with " + how);
  }
}

}  // namespace tessera::soak
