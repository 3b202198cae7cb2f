// The state of a fleet as text and as JSON, for `tessera fleet --status`.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "server/fleet/fleet.h"

namespace tessera {

// `titles`: of tasks, by name; a task without a title is shown by its name. A table of the classes (wanted, running and
// pending pilots, other workers, why there are not more), one of the pilots, then the messages.
std::string FleetStatusText(const FleetFile& fleet, const FleetView& view,
                            const std::map<std::string, std::string>& titles, double now_s);

// {"name", "classes": [{"name", "memory_bytes", "wanted", "running", "pending", "others", "why"}], "pilots": [{"job",
// "class", "state", "seconds", "reason", "worker", "tasks": [{"task", "title"}]}], "messages": [...]}
std::string FleetStatusJson(const FleetFile& fleet, const FleetView& view,
                            const std::map<std::string, std::string>& titles, double now_s);

}  // namespace tessera
