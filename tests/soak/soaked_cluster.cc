#include "tests/soak/soaked_cluster.h"

#include <signal.h>

#include <filesystem>
#include <limits>

#include "tests/e2e/namespaces.h"

namespace tessera::soak {
namespace {

constexpr int64_t kDisk_bytes = int64_t{1} << 30;
constexpr double kEnd_s = 60;     // that a program may take to end
constexpr double kAgain_s = 0.5;  // after a start that was refused

}  // namespace

void SoakedCluster::MountOn(const std::string& folder) {
  if (const Status mounted = e2e::MountMemory(folder, kDisk_bytes); !mounted.ok()) {
    throw std::runtime_error(mounted.ToString());
  }
}

SoakedCluster::SoakedCluster(const std::string& folder, int workers, bool disks, uint64_t seed, History& history)
    : folder_(folder), disks_(disks), seed_(seed), history_(history) {
  if (disks_) {
    MountOn(folder_ + "/data");
    MountOn(folder_ + "/data/blobs");
  }
  cluster_ = std::make_unique<e2e::Cluster>(folder_, kLease_s);
  workers_.resize(workers);
  for (int i = 0; i < workers; ++i) {
    Worker& worker = workers_[i];
    worker.network = std::make_unique<e2e::TcpProxy>(cluster_->address());
    worker.scratch = folder_ + "/scratch-" + std::to_string(i);
    if (disks_) MountOn(worker.scratch);
    StartWorker(worker);
  }
}

SoakedCluster::~SoakedCluster() {
  cluster_.reset();
  if (!disks_) return;
  for (const Worker& worker : workers_) e2e::Unmount(worker.scratch).IgnoreError();
  e2e::Unmount(folder_ + "/data/blobs").IgnoreError();
  e2e::Unmount(folder_ + "/data").IgnoreError();
}

void SoakedCluster::StartWorker(Worker& worker) {
  worker.shared = RandomOf(seed_, 'w', starts_++).Below(2) == 0;
  std::vector<std::string> arguments = {"--coordinator", worker.network->address(), "--work", worker.scratch};
  if (!worker.shared) arguments.push_back("--no-shared-storage");
  worker.program = &cluster_->AddWorker(arguments);
  worker.end = worker.scratch_harmed ? End::kRefuses : End::kNone;
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
  e2e::Program& coordinator = cluster_->coordinator();
  if (coordinator.Running()) return;
  calm_since_s_ = std::numeric_limits<double>::infinity();
  if (!IsAsExpected(coordinator_end_, coordinator)) {
    throw Violation("the coordinator ended with " + coordinator.ExitDescription() + ", which nobody asked it to");
  }
  if (now_s < coordinator_start_s_) return;
  try {
    cluster_->StartCoordinator();
    coordinator_end_ = End::kNone;
    calm_since_s_ = history_.Now_s();
    ++restarts_;
  } catch (const std::runtime_error& error) {
    if (harms_of_state_ == 0) throw Violation(std::string("the coordinator does not start again: ") + error.what());
    history_.Note("the coordinator cannot start");
    coordinator_end_ = End::kRefuses;
    coordinator_start_s_ = now_s + kAgain_s;
    ++refused_starts_;
  }
}

double SoakedCluster::CalmSince_s() {
  const bool calm = !coordinator_stopped_ && coordinator_end_ == End::kNone;
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
  if (!cluster_->coordinator().Running() || coordinator_end_ != End::kNone) return false;
  coordinator_end_ = kill ? End::kKilled : End::kDrains;
  coordinator_start_s_ = history_.Now_s() + back_s;
  if (kill) {
    cluster_->coordinator().Kill();
  } else {
    cluster_->coordinator().Signal(SIGTERM);
  }
  return true;
}

void SoakedCluster::StopCoordinator(bool stop) {
  coordinator_stopped_ = stop;
  if (!stop) calm_since_s_ = history_.Now_s();
  cluster_->coordinator().Signal(stop ? SIGSTOP : SIGCONT);
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
  for (Worker& worker : workers_) {
    if (worker.program->Running()) worker.program->Signal(SIGTERM);
    if (!e2e::WaitUntil([&] { return !worker.program->Running(); }, kEnd_s)) {
      throw Violation("a worker does not drain:\n" + worker.program->Output());
    }
    if (worker.program->ExitDescription() != "exit code 0") {
      throw Violation("a worker that drains ended with " + worker.program->ExitDescription());
    }
  }
  cluster_->coordinator().Signal(SIGTERM);
  if (!e2e::WaitUntil([&] { return !cluster_->coordinator().Running(); }, kEnd_s)) {
    throw Violation("the coordinator does not end:\n" + cluster_->coordinator().Output());
  }
  if (cluster_->coordinator().ExitDescription() != "exit code 0") {
    throw Violation("the coordinator ended with " + cluster_->coordinator().ExitDescription());
  }
}

}  // namespace tessera::soak
