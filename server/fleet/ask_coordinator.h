// Asks a coordinator for what a fleet needs to know.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/rpc/channel.h"
#include "server/fleet/fleet.h"

namespace tessera {

class Connection;

// Needs a viewer's token. Connects again after a failure. Not thread-safe.
class CoordinatorLink {
 public:
  // `file` must outlive it.
  CoordinatorLink(const FleetFile& file, const Endpoint& endpoint);
  ~CoordinatorLink();

  // UNAVAILABLE while no coordinator answers; an error if the answer does not fit the classes.
  StatusOr<CoordinatorView> Ask();
  // Titles of these tasks by name, as far as they are known. Reads all tasks of their jobs.
  std::map<std::string, std::string> Titles(const std::vector<std::string>& tasks);

 private:
  StatusOr<CoordinatorView> AskConnected();

  const FleetFile& file_;
  const Endpoint endpoint_;
  std::unique_ptr<Connection> connection_;
};

}  // namespace tessera
