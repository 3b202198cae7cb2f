// PostgreSQL and an S3 store that a soak starts for itself, kills, suspends and starts again.
#pragma once

#include <cstdio>
#include <map>
#include <memory>
#include <string>

#include "tests/e2e/programs.h"

namespace tessera::soak {

enum class Server { kPostgres, kGateway };

// Not thread-safe. Sets TESSERA_TEST_SERVERS, so that tests/support/servers/test_server.h finds these servers.
class OwnServers {
 public:
  // Starts both servers. `folder`: new, for their addresses and logs. Throws std::runtime_error if one does not start.
  explicit OwnServers(const std::string& folder);
  // Stops both and removes their data. If this process is killed, another one does that.
  ~OwnServers();
  OwnServers(const OwnServers&) = delete;
  OwnServers& operator=(const OwnServers&) = delete;

  // The package without which a server cannot be started; empty: both run.
  const std::string& missing() const { return missing_; }

  // Ends the server by SIGKILL; PostgreSQL with its sessions.
  void Kill(Server server);
  // Starts a killed server on its old data and port. Does not wait.
  void StartAgain(Server server);
  // While suspended, the gateway accepts connections and answers nothing.
  void SuspendGateway(bool suspended);
  // Whether the server is neither killed nor suspended. Throws std::runtime_error if it cannot be started again.
  bool Serves(Server server);
  // Starts what was killed, resumes what is suspended, and waits until both serve.
  void Restore();

 private:
  struct State {
    bool killed = false, suspended = false;
    std::unique_ptr<e2e::Program> start;  // of the killed server
  };

  std::unique_ptr<e2e::Program> Script(Server server, const std::string& action);
  // Throws std::runtime_error if the script fails.
  void RunScript(Server server, const std::string& action);
  void Stop();

  const std::string folder_;
  std::FILE* guard_ = nullptr;  // the other process stops the servers when this pipe is closed
  std::string missing_;
  std::map<Server, State> states_;
};

}  // namespace tessera::soak
