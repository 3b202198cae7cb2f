// Pilots as the scheduler lists them.
#pragma once

#include <string>

namespace tessera {

enum class PilotState { kPending, kRunning, kEnded };

// How a pilot ended.
enum class PilotEnd {
  kSucceeded,
  kFailed,     // its own fault: exit code, out of memory, out of time
  kTakenAway,  // cancelled or preempted, or its node failed
};

struct Pilot {
  std::string job;         // as the cancel command takes it: "17_3"
  std::string allocation;  // as its worker registers it; empty: not known before it starts
  int pilot_class = 0;     // index in FleetFile.classes
  PilotState state = PilotState::kPending;
  PilotEnd end = PilotEnd::kSucceeded;                 // if it has ended
  std::string reason;                                  // why it is pending, or how it ended
  std::string output;                                  // file; empty: not known
  double submitted_s = 0, started_s = 0, ended_s = 0;  // Unix time; 0: not known
};

}  // namespace tessera
