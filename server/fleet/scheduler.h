// The scheduler that runs the pilots.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/fleet/fleet_file.h"
#include "server/fleet/pilot.h"

namespace tessera {

class Scheduler {
 public:
  virtual ~Scheduler() = default;
  // All pilots of the fleet: pending, running, and those that ended lately. An error if that is not known.
  virtual StatusOr<std::vector<Pilot>> List() = 0;
  // Returns what the command prints. After an error the pilots may exist all the same.
  virtual StatusOr<std::string> Submit(const PilotClass& pilots, int count) = 0;
  virtual Status Cancel(const std::vector<std::string>& jobs) = 0;
};

// Runs the commands of the fleet's file; its folder `logs` must be set. `interrupts`: the number of signals so far. The
// first ends `list`; the second also ends the others, whose effect would then be unknown. Not thread-safe.
class CommandScheduler : public Scheduler {
 public:
  CommandScheduler(const FleetFile& fleet, std::function<int()> interrupts);
  StatusOr<std::vector<Pilot>> List() override;
  StatusOr<std::string> Submit(const PilotClass& pilots, int count) override;
  Status Cancel(const std::vector<std::string>& jobs) override;

 private:
  StatusOr<std::string> Run(const std::vector<std::string>& words, int most_interrupts);

  const FleetFile& fleet_;
  const std::function<int()> interrupts_;
};

}  // namespace tessera
