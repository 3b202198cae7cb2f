// A coordinator and workers that are stopped, killed, disconnected and restarted.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/base/random.h"
#include "tests/e2e/programs.h"
#include "tests/e2e/tcp_proxy.h"
#include "tests/soak/history.h"
#include "tests/soak/server_storage.h"

namespace tessera::soak {

// How a program is to end next, if it does. kRefuses: it finds that it cannot start. kReplaced: it has lost its right
// to write the state.
enum class End { kNone, kDrains, kKilled, kRefuses, kReplaced };

class SoakedCluster {
 public:
  static constexpr double kLease_s = 2;

  struct Worker {
    std::unique_ptr<e2e::TcpProxy> network;
    std::string scratch;
    bool shared = true;  // reads the coordinator's folders
    std::unique_ptr<e2e::Program> program;
    End end = End::kNone;
    double start_s = 0;           // when it is to be started again
    bool stopped = false;         // stands still
    bool scratch_harmed = false;  // now
  };

  // With `disks`: the coordinator's folder, its blobs and each scratch folder are small file systems, of mounts of
  // one's own. `storage`: of state and blobs, must outlive it; null: they are in the coordinator's folder.
  SoakedCluster(const std::string& folder, int workers, bool disks, ServerStorage* storage, uint64_t seed,
                History& history);
  ~SoakedCluster();

  // Starts what is due again, without waiting. Throws Violation if a program ended that nobody ended.
  void Supervise();
  // Nothing stands still, is away or waits to be started any more.
  void LiftAll();
  // All workers drain, then the coordinator ends. Throws Violation unless all go well.
  void Finish();

  void HarmScratch(int index, bool harmed);
  // False if it ends already.
  bool EndWorker(int index, bool kill, double back_s);
  void StopWorker(int index, bool stop);
  bool EndCoordinator(bool kill, double back_s);
  void StopCoordinator(bool stop);
  // One thing more, or less, for which the coordinator may not start.
  void AddHarmOfState(int change);
  // While the database is away, the coordinator need not answer.
  void SetDatabaseAway(bool away);

  std::vector<Worker>& workers() { return workers_; }
  ServerStorage* storage() { return storage_; }
  const std::string& address() const { return address_; }
  const std::string& data() const { return data_; }
  const std::string& folder() const { return folder_; }
  bool coordinator_stopped() const { return coordinator_stopped_; }
  // Since when the coordinator has been there without a fault of its own; infinite while it has one.
  double CalmSince_s();
  int restarts() const { return restarts_; }
  int refused_starts() const { return refused_starts_; }
  // How often a coordinator ended because it had lost its right to write the state.
  int replacements() const { return replacements_; }

 private:
  void StartCoordinator();
  void SuperviseCoordinator();
  // Sets how the coordinator has ended. Throws Violation unless it was ended or had a reason.
  void TakeCoordinatorEnd();
  void StartWorker(Worker& worker);
  static void MountOn(const std::string& folder);

  const std::string folder_, data_, port_file_, address_;
  const bool disks_;
  ServerStorage* const storage_;
  const uint64_t seed_;
  History& history_;
  std::unique_ptr<e2e::Program> coordinator_;
  std::vector<Worker> workers_;
  End coordinator_end_ = End::kNone;
  double coordinator_start_s_ = 0, calm_since_s_ = 0;
  bool coordinator_stopped_ = false, database_away_ = false;
  bool starting_ = false;        // the coordinator was started and does not listen yet
  bool start_harmed_ = false;    // something was harmed since it was started
  double starting_since_s_ = 0;  // without harm
  int harms_of_state_ = 0, starts_ = 0, restarts_ = 0, refused_starts_ = 0, replacements_ = 0;
};

}  // namespace tessera::soak
