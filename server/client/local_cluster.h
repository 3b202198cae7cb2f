// A coordinator and workers on this machine, owned by one command.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/retry/retry.h"
#include "common/base/status.h"
#include "common/storage/files.h"
#include "server/client/child_process.h"

namespace tessera {

struct LocalClusterOptions {
  std::string state_dir;  // the workers' folders, port file and logs/
  std::string data_dir;   // the coordinator's
  int workers = 1;
  int threads_per_worker = 1;
  bool shared_storage = true;
  // May be s3://BUCKET/PREFIX; the coordinator finds the store and its credentials as AWS's tools do.
  std::string scene = {};
};

// How many workers to start on a machine: one per 4 cores, because several tasks at once use many cores better than one
// task; at least two, or one on a single core. From the third on, each has room for a tile of `tile_bytes` and for what
// a worker keeps in memory between tasks. The coordinator divides the cores between the tasks that run.
int WorkersFor(int cores, int64_t memory_bytes, int64_t tile_bytes);

// Not thread-safe: the same thread starts, supervises and stops it. The children are killed when that thread ends.
class LocalCluster {
 public:
  // Starts tesserad (from this program's folder) and the workers; returns when the coordinator listens. `wait` sleeps
  // between polls; if it returns false, the start is aborted (CANCELLED). FAILED_PRECONDITION if another process uses
  // the folder.
  static StatusOr<std::unique_ptr<LocalCluster>> Start(const LocalClusterOptions& options, const Clock& clock,
                                                       const Sleeper& wait);
  // Kills processes that still run.
  ~LocalCluster();

  // unix:PATH of the coordinator, in a folder that only this user may enter.
  const std::string& address() const { return address_; }

  // Replaces workers that died and adds a line to `notes` for each. An error with the last lines of the log if the
  // coordinator died or a worker repeatedly died right after its start.
  Status Supervise(std::vector<std::string>* notes);

  static constexpr double kStopSeconds = 8;  // usual time limit of Stop

  // Sends SIGTERM to all processes, waits up to `seconds` (with `wait`), then kills them.
  void Stop(double seconds, const Sleeper& wait);

 private:
  struct Worker {
    std::unique_ptr<ChildProcess> process;
    int64_t start_us = 0;
    int early_deaths = 0;  // in a row
  };

  LocalCluster(const LocalClusterOptions& options, const Clock& clock, FileLock lock)
      : options_(options), clock_(clock), lock_(std::move(lock)) {}
  Status StartCoordinator(const Sleeper& wait);
  Status StartWorker(int index);
  std::string LogPath(const std::string& name) const { return options_.state_dir + "/logs/" + name + ".log"; }
  Status Died(ChildProcess& process, const std::string& name) const;

  const LocalClusterOptions options_;
  const Clock& clock_;
  FileLock lock_;
  std::string program_folder_;
  std::optional<TempFolder> socket_folder_;  // used if the data folder's path is too long for a socket
  std::string address_;
  std::unique_ptr<ChildProcess> coordinator_;
  std::vector<Worker> workers_;
};

}  // namespace tessera
