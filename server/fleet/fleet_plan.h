// Decides how many pilots to submit and which to cancel. Without effects.
#pragma once

#include <string>
#include <vector>

#include "server/fleet/backoff.h"
#include "server/fleet/fleet_file.h"
#include "server/fleet/pilot.h"

namespace tessera {

// What the coordinator says.
struct FleetDemand {
  struct Unfit {
    std::string task, title;
    int64_t memory_bytes = 0;
    double core_s = 0;
  };
  std::vector<int> wanted;   // by class: workers for the tasks of this class and of all larger ones together
  std::vector<Unfit> unfit;  // tasks that fit no class; the first ones
  int64_t unfit_count = 0;
};
struct FleetWorker {
  std::string name, allocation;
  int64_t memory_bytes = 0;
  bool suspended = false;
  std::vector<std::string> tasks;  // "jobs/J/tasks/T"
};

struct ClassPlan {
  int running = 0, pending = 0;  // pilots
  int others = 0;                // workers of this size that are no pilots of this fleet
  int submit = 0;
  std::vector<std::string> cancel;  // pending pilots
  std::string why;                  // there are not more pilots, or why they are pending; empty: nothing to say
};

// A message is printed again only when the text of its subject changes.
struct FleetMessage {
  std::string subject, text;
};

struct FleetPlan {
  std::vector<ClassPlan> classes;
  std::vector<FleetMessage> messages;
};

// From the largest class to the smallest: pilots that are running or pending, and other workers, also count for all
// smaller classes; what is missing is submitted in its own class, within `most` and `most_pending`. Then pending pilots
// are cancelled that no class needs, the newest first. Running pilots are never cancelled. A class that is stopped gets
// no pilots; after a stop it gets one. Nothing is submitted while the answer of the last submit is unknown.
FleetPlan PlanFleet(const FleetFile& fleet, const FleetDemand& demand, const std::vector<Pilot>& pilots,
                    const std::vector<FleetWorker>& workers, const FleetBackoff& backoff, double now_s);

}  // namespace tessera
