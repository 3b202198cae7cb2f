// A coordinator and workers on this machine, for as long as one command runs.
#ifndef TESSERA_SERVER_CLIENT_LOCAL_CLUSTER_H_
#define TESSERA_SERVER_CLIENT_LOCAL_CLUSTER_H_

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/rpc/retry.h"
#include "common/storage/files.h"
#include "server/client/child_process.h"

namespace tessera {

struct LocalClusterOptions {
  std::string state_dir;  // the workers' folders, port file and logs/
  std::string data_dir;   // the coordinator's
  int workers = 1;
  int threads_per_worker = 1;
  bool shared_storage = true;
};

// Not thread-safe: one thread starts it, looks after it and stops it (its end takes the children with it).
class LocalCluster {
 public:
  // Starts tesserad, found beside this program, and the workers; returns when the coordinator listens. `wait` is called
  // while waiting; false breaks off (CANCELLED). FAILED_PRECONDITION if another process uses the folder.
  static StatusOr<std::unique_ptr<LocalCluster>> Start(const LocalClusterOptions& options, const Clock& clock,
                                                       const Sleeper& wait);
  // Stops whatever still runs.
  ~LocalCluster();

  // unix:PATH of the coordinator, in a folder that no other user may enter.
  const std::string& address() const { return address_; }

  // Replaces workers that died; tells each in `notes`. An error, with the last lines of the log, if the coordinator
  // died or workers keep dying as soon as they start.
  Status LookAfter(std::vector<std::string>* notes);

  static constexpr double kStopSeconds = 8;  // that programs usually get for it

  // Asks all to end, waits up to `seconds` (with `wait`), then kills.
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
  std::optional<TempFolder> socket_folder_;  // where the data folder's path is too long for a socket
  std::string address_;
  std::unique_ptr<ChildProcess> coordinator_;
  std::vector<Worker> workers_;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_CLIENT_LOCAL_CLUSTER_H_
