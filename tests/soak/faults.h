// Random temporary faults of a cluster.
#pragma once

#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "common/base/random.h"
#include "tests/soak/soaked_cluster.h"

namespace tessera::soak {

class Faults {
 public:
  // All must outlive it. `disks`: the cluster's folders are small file systems, which can be full. A cluster with
  // ServerStorage has faults of its servers, too.
  Faults(SoakedCluster& cluster, bool disks, uint64_t seed, History& history, std::map<std::string, int>& counts);

  // Lets a fault begin, counted by its kind; none if the one that is drawn cannot be now.
  void Strike();
  // Ends those whose time is over.
  void Lift();
  // Ends all, and waits until the servers serve again.
  void LiftAll();

 private:
  struct Kind {
    const char* name;
    double weight;
    std::function<bool()> begin;  // false: it cannot be now
  };

  // Always true.
  bool Until(double for_s, std::function<void()> lift);
  // A worker's place.
  int Any();
  // Shorter than a lease or longer, by chance.
  double Pause_s();
  void AddServerKinds();
  bool KillServer(Server server);
  bool SuspendGateway();
  // Takes note of servers that serve again.
  void LookAtServers();
  bool LockDatabase();
  bool LockRecords();
  bool FillDisk();
  bool HarmBlob();
  bool TakeScratch();

  SoakedCluster& cluster_;
  History& history_;
  std::map<std::string, int>& counts_;
  const uint64_t seed_;
  int strikes_ = 0;
  Random random_{0};  // of the fault that begins now
  std::vector<Kind> kinds_;
  std::multimap<double, std::function<void()>> lifts_;  // by when they are due
  std::string what_;                                    // of the fault that begins now
  bool database_locked_ = false;
  std::set<std::string> harmed_;  // folders, now
  std::map<Server, int> away_;    // killed or suspended, now; with their harms of the state
};

}  // namespace tessera::soak
