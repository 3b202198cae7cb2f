// When a class of pilots fails, it is stopped and tried again later. This is all that a fleet remembers.
#pragma once

#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/fleet/fleet_file.h"
#include "server/fleet/pilot.h"

namespace tessera {

inline constexpr int kFailuresToStop = 3;        // pilots in a row that end without having registered
inline constexpr double kFirstStop_s = 600;      // then twice and four times as long
inline constexpr int kListsAfterLostAnswer = 2;  // before the next submit

struct ClassBackoff {
  int failures = 0;        // in a row
  int stops = 0;           // in a row; above 0: one pilot is tried at a time
  double retry_s = 0;      // Unix time until which the class is stopped
  std::string reason;      // of the last failure
  int submitted = 0;       // pilots of the last submit that no list has shown yet
  double submitted_s = 0;  // Unix time of that submit

  bool StoppedAt(double now_s) const { return stops > 0 && now_s < retry_s; }
};

// What is known of a pilot that was in the last list.
struct KnownPilot {
  std::string pilot_class;
  std::string output;
  bool registered = false;  // its worker was seen
  bool judged = false;      // its end does not count, or counts already
};

struct FleetBackoff {
  std::string file;                             // hash of the fleet's file
  std::map<std::string, ClassBackoff> classes;  // by name
  std::map<std::string, KnownPilot> pilots;     // by job
  int lists_before_submit = 0;                  // after a submit whose answer was lost
};

// One line of JSON. Parse: INVALID_ARGUMENT if the text is none.
std::string BackoffText(const FleetBackoff& backoff);
StatusOr<FleetBackoff> ParseBackoff(const std::string& text);

// Updates the back-off by a list. `allocations`: of the registered workers. `last_lines`: of a pilot's output.
// A pilot has registered if its allocation was among them, or if it ran longer than an interval and succeeded. One that
// was cancelled, preempted or on a node that failed does not count. A pilot that is no longer listed counts as ended.
void JudgePilots(const FleetFile& fleet, const std::vector<Pilot>& pilots, const std::set<std::string>& allocations,
                 double now_s, const std::function<std::string(const std::string& output)>& last_lines,
                 FleetBackoff* backoff);

// After a submit: its pilots count as pending until they are listed.
void CountSubmit(const FleetFile& fleet, int pilot_class, int count, double now_s, FleetBackoff* backoff);
// After a submit that failed or was not answered: the pilots may exist.
void CountLostSubmit(const FleetFile& fleet, int pilot_class, const std::string& reason, double now_s,
                     FleetBackoff* backoff);

}  // namespace tessera
