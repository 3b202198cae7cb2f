// One round of a fleet: asks the coordinator and the scheduler, then submits and cancels pilots.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "server/fleet/backoff.h"
#include "server/fleet/fleet_file.h"
#include "server/fleet/fleet_plan.h"
#include "server/fleet/scheduler.h"

namespace tessera {

// What the coordinator knows of a fleet.
struct CoordinatorView {
  FleetDemand demand;
  std::vector<FleetWorker> workers;
};

// All that a round found and planned.
struct FleetView {
  CoordinatorView coordinator;
  std::vector<Pilot> pilots;
  FleetPlan plan;
};

struct FleetParts {
  std::function<StatusOr<CoordinatorView>()> ask_coordinator;
  Scheduler* scheduler = nullptr;
  const Clock* clock = nullptr;
  std::string backoff_path;
  // Gets each message of a subject when it first appears or changes, and "no longer: ..." when it holds no more.
  std::function<void(const FleetMessage& message)> notify;
};

// Not thread-safe. Only one per name and scheduler should run; if there are two, each lists the pilots right before it
// submits, so together they exceed `most` by one array at most.
class Fleet {
 public:
  // `file` and what `parts` refers to must outlive it. A back-off file that cannot be read is reported, and an empty
  // one is used; one that was written for another content of `file` (`file_text`) no longer stops a class.
  Fleet(const FleetFile& file, const std::string& file_text, FleetParts parts);

  // Submits at most one array per class, cancels pending pilots that nobody needs. If the coordinator does not answer,
  // or the list of jobs is not known, it does nothing and returns the error. A submit or cancel command that fails is
  // reported. The back-off is stored.
  Status Round();

  // The same view and plan, without any change.
  StatusOr<FleetView> Look();

 private:
  // Both in FleetView; updates the back-off.
  Status Update(FleetView* view);
  void Notify(const std::vector<FleetMessage>& messages);
  void NotifyError(const std::string& subject, const Status& status);
  bool SubmitOne(const FleetPlan& plan, std::vector<bool>* submitted);
  void CancelPending(const FleetPlan& plan);
  void Store();
  double Now_s() const;

  const FleetFile& file_;
  const FleetParts parts_;
  const std::string file_hash_;
  FleetBackoff backoff_;
  std::string stored_;
  std::map<std::string, std::string> notified_;  // texts by subject
};

}  // namespace tessera
