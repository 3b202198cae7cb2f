#include "server/client/local_cluster.h"

#include <unistd.h>

#include <algorithm>

#include "common/rpc/channel.h"
#include "common/s3/s3_location.h"

namespace tessera {
namespace {

constexpr double kStartSeconds = 60;  // until the coordinator listens
constexpr double kPollSeconds = 0.02;
constexpr int64_t kEarlyUs = 5'000'000;  // a worker that dies sooner than this after its start died early
constexpr int kMaxEarlyDeaths = 5;
constexpr int kLogLines = 15;
constexpr int kCoresOfWorker = 4;
constexpr double kKeptBytes = 3.0 * (1 << 30);  // at most, of a worker between tasks: tiles, freed memory
constexpr char kLeaseSeconds[] = "10";  // short: on one machine a silent worker is most likely dead

// The programs that are started are in packages of their own. NOT_FOUND names the one to install.
Status CheckProgram(const std::string& path, const std::string& package) {
  if (::access(path.c_str(), X_OK) == 0) return absl::OkStatus();
  return absl::NotFoundError(path + ": found no executable program; install the Debian package " + package);
}

}  // namespace

int WorkersFor(int cores, int64_t memory_bytes, int64_t tile_bytes) {
  const double fit = static_cast<double>(memory_bytes) / (static_cast<double>(tile_bytes) + kKeptBytes);
  const int most = static_cast<int>(std::min<double>(cores / kCoresOfWorker, fit));
  return std::max(most, std::min(2, cores));
}

StatusOr<std::unique_ptr<LocalCluster>> LocalCluster::Start(const LocalClusterOptions& options, const Clock& clock,
                                                            const Sleeper& wait) {
  TESSERA_RETURN_IF_ERROR(EnsurePrivateFolder(options.state_dir));
  TESSERA_RETURN_IF_ERROR(EnsureFolder(options.state_dir + "/logs"));
  auto lock = FileLock::Acquire(options.state_dir + "/lock");
  if (!lock.ok())
    return absl::FailedPreconditionError("another tessera run uses " + options.state_dir +
                                         "; wait for it, or use another --out");
  std::unique_ptr<LocalCluster> cluster(new LocalCluster(options, clock, *std::move(lock)));
  TESSERA_ASSIGN_OR_RETURN(cluster->program_folder_, ProgramFolder());
  TESSERA_RETURN_IF_ERROR(CheckProgram(cluster->program_folder_ + "/tesserad", "tessera-coordinator"));
  TESSERA_RETURN_IF_ERROR(CheckProgram(cluster->program_folder_ + "/tessera-worker", "tessera-worker"));
  TESSERA_RETURN_IF_ERROR(cluster->StartCoordinator(wait));
  cluster->workers_.resize(options.workers);
  for (int i = 0; i < options.workers; ++i) TESSERA_RETURN_IF_ERROR(cluster->StartWorker(i));
  return cluster;
}

LocalCluster::~LocalCluster() = default;

Status LocalCluster::Died(ChildProcess& process, const std::string& name) const {
  return absl::InternalError(name + " ended with " + process.ExitDescription() + "; the last lines of " +
                             process.log() + ":\n" + LastLines(process.log(), kLogLines));
}

Status LocalCluster::StartCoordinator(const Sleeper& wait) {
  const std::string port_file = options_.state_dir + "/address";
  TESSERA_RETURN_IF_ERROR(RemoveTree(port_file));
  std::string socket = "unix:" + options_.data_dir + "/socket";
  if (!CheckAddress(socket).ok()) {
    TESSERA_ASSIGN_OR_RETURN(socket_folder_, TempFolder::Create("", "tessera-"));
    socket = "unix:" + socket_folder_->path() + "/socket";
  }
  // The coordinator runs as the user, so it may read every file that the user may read.
  std::vector<std::string> arguments = {"--listen",        socket,      "--port-file", port_file,      "--data",
                                        options_.data_dir, "--lease-s", kLeaseSeconds, "--scene-root", "/"};
  if (IsS3Url(options_.scene)) {  // the base job's scene may lie elsewhere in the bucket
    const size_t bucket_end = options_.scene.find('/', std::string("s3://").size());
    arguments.insert(arguments.end(), {"--scene-root", options_.scene.substr(0, bucket_end)});
  }
  if (!options_.shared_storage) arguments.push_back("--no-shared-storage");
  TESSERA_ASSIGN_OR_RETURN(coordinator_,
                           ChildProcess::Start(program_folder_ + "/tesserad", arguments, LogPath("tesserad")));
  const int64_t deadline_us = clock_.MonotonicUs() + static_cast<int64_t>(kStartSeconds * 1e6);
  while (true) {
    if (const auto address = ReadFile(port_file, 1024); address.ok() && !address->empty()) {
      address_ = address->substr(0, address->find('\n'));
      return absl::OkStatus();
    }
    if (!coordinator_->Running()) return Died(*coordinator_, "tesserad");
    if (clock_.MonotonicUs() > deadline_us) {
      return absl::DeadlineExceededError("tesserad did not start within 60 s; the last lines of " +
                                         coordinator_->log() + ":\n" + LastLines(coordinator_->log(), kLogLines));
    }
    if (!wait(kPollSeconds)) return absl::CancelledError("interrupted");
  }
}

Status LocalCluster::StartWorker(int index) {
  const std::string name = "worker-" + std::to_string(index + 1);
  std::vector<std::string> arguments = {"--coordinator", address_,
                                        "--work",        options_.state_dir + "/workers/" + name,
                                        "--threads",     std::to_string(options_.threads_per_worker)};
  if (!options_.shared_storage) arguments.push_back("--no-shared-storage");
  TESSERA_ASSIGN_OR_RETURN(workers_[index].process,
                           ChildProcess::Start(program_folder_ + "/tessera-worker", arguments, LogPath(name)));
  workers_[index].start_us = clock_.MonotonicUs();
  return absl::OkStatus();
}

Status LocalCluster::Supervise(std::vector<std::string>* notes) {
  if (!coordinator_->Running()) return Died(*coordinator_, "tesserad");
  for (size_t i = 0; i < workers_.size(); ++i) {
    Worker& worker = workers_[i];
    if (worker.process->Running()) continue;
    const std::string name = "worker " + std::to_string(i + 1);
    const bool early = clock_.MonotonicUs() - worker.start_us < kEarlyUs;
    worker.early_deaths = early ? worker.early_deaths + 1 : 0;
    if (worker.early_deaths >= kMaxEarlyDeaths) return Died(*worker.process, name);
    notes->push_back(name + " (process " + std::to_string(worker.process->pid()) + ") ended with " +
                     worker.process->ExitDescription() + "; starting a replacement");
    TESSERA_RETURN_IF_ERROR(StartWorker(static_cast<int>(i)));
  }
  return absl::OkStatus();
}

void LocalCluster::Stop(double seconds, const Sleeper& wait) {
  const int64_t deadline_us = clock_.MonotonicUs() + static_cast<int64_t>(seconds * 1e6);
  const auto any_worker = [&] {
    return std::any_of(workers_.begin(), workers_.end(),
                       [](Worker& worker) { return worker.process != nullptr && worker.process->Running(); });
  };
  for (Worker& worker : workers_) {
    if (worker.process != nullptr) worker.process->Terminate();
  }
  while (any_worker() && clock_.MonotonicUs() < deadline_us && wait(kPollSeconds)) {
  }
  workers_.clear();
  if (coordinator_ == nullptr) return;
  coordinator_->Terminate();
  while (coordinator_->Running() && clock_.MonotonicUs() < deadline_us && wait(kPollSeconds)) {
  }
  coordinator_ = nullptr;
}

}  // namespace tessera
