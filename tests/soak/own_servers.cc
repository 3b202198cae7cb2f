#include "tests/soak/own_servers.h"

#include <signal.h>
#include <stdlib.h>

#include <filesystem>
#include <stdexcept>
#include <utility>

#include "common/storage/files.h"
#include "tests/support/servers/test_server.h"

namespace tessera::soak {
namespace {

constexpr double kServerStart_s = 120;  // limit

const char* NameOf(Server server) { return server == Server::kPostgres ? "postgres" : "radosgw"; }

const char* ScriptOf(Server server) {
  return server == Server::kPostgres ? TESSERA_START_POSTGRES : TESSERA_START_RADOSGW;
}

void SignalGateway(int signal) { ::kill(std::stoi(ServerFile(NameOf(Server::kGateway), "pid")), signal); }

std::string Quoted(const std::string& word) {
  std::string quoted = "'";
  for (const char c : word) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

// Starts a process that waits until the returned pipe is closed, by this process or by its end, and then stops the
// servers whose folder still exists. It is no child of this process: ctest kills the children, too.
std::FILE* StartGuard(const std::string& folder) {
  std::string stop = "cat >/dev/null; [ -d " + Quoted(folder) + " ] || exit; ";
  for (const Server server : {Server::kPostgres, Server::kGateway}) {
    stop += Quoted(ScriptOf(server)) + " " + Quoted(folder + "/" + NameOf(server)) + " stop; ";
  }
  stop += "rm -rf " + Quoted(folder);
  const std::string command = "exec 3<&0; setsid sh -c " + Quoted(stop) + " <&3 3<&- >/dev/null 2>&1 &";
  std::FILE* const guard = ::popen(command.c_str(), "we");
  if (guard == nullptr) throw std::runtime_error("cannot start the process that stops the servers");
  return guard;
}

}  // namespace

OwnServers::OwnServers(const std::string& folder) : folder_(folder) {
  if (!EnsureFolder(folder_).ok()) throw std::runtime_error("cannot create " + folder_);
  guard_ = StartGuard(folder_);
  ::setenv("TESSERA_TEST_SERVERS", folder_.c_str(), 1);
  try {
    for (const Server server : {Server::kPostgres, Server::kGateway}) {
      const auto start = Script(server, "");
      const e2e::Outcome started = start->Wait();
      if (missing_ = ServerFile(NameOf(server), "missing"); !missing_.empty()) return;
      if (started.exit_code != 0) {
        throw std::runtime_error(std::string(NameOf(server)) + " does not start: " + started.output);
      }
    }
  } catch (...) {
    Stop();
    throw;
  }
}

OwnServers::~OwnServers() { Stop(); }

void OwnServers::Stop() {
  for (auto& [server, state] : states_) state.start.reset();
  for (const Server server : {Server::kPostgres, Server::kGateway}) {
    try {
      RunScript(server, "stop");
    } catch (const std::exception& error) {
      std::fprintf(stderr, "%s\n", error.what());
    }
  }
  std::error_code ignored;
  std::filesystem::remove_all(folder_, ignored);
  ::pclose(guard_);
}

std::unique_ptr<e2e::Program> OwnServers::Script(Server server, const std::string& action) {
  std::vector<std::string> arguments = {folder_ + "/" + NameOf(server)};
  if (!action.empty()) arguments.push_back(action);
  return std::make_unique<e2e::Program>(folder_ + "/logs", ScriptOf(server), arguments);
}

void OwnServers::RunScript(Server server, const std::string& action) {
  const e2e::Outcome outcome = Script(server, action)->Wait();
  if (outcome.exit_code == 0) return;
  throw std::runtime_error(std::string("start-") + NameOf(server) + " " + action + " failed: " + outcome.output);
}

void OwnServers::Kill(Server server) {
  states_[server].killed = true;
  if (server == Server::kPostgres) return RunScript(server, "kill");
  SignalGateway(SIGKILL);  // the script waits until the process is gone, which may take seconds
}

void OwnServers::StartAgain(Server server) { states_[server].start = Script(server, "again"); }

void OwnServers::SuspendGateway(bool suspended) {
  states_[Server::kGateway].suspended = suspended;
  SignalGateway(suspended ? SIGSTOP : SIGCONT);
}

bool OwnServers::Serves(Server server) {
  State& state = states_[server];
  if (state.start != nullptr && !state.start->Running()) {
    const e2e::Outcome started = std::exchange(state.start, nullptr)->Wait();
    if (started.exit_code != 0) {
      throw std::runtime_error(std::string(NameOf(server)) + " does not start again: " + started.output);
    }
    state.killed = false;
  }
  return !state.killed && !state.suspended;
}

void OwnServers::Restore() {
  for (auto& [server, state] : states_) {
    if (state.suspended) SuspendGateway(false);
    if (state.killed && state.start == nullptr) StartAgain(server);
    if (!e2e::WaitUntil([&, which = server] { return Serves(which); }, kServerStart_s)) {
      throw std::runtime_error(std::string(NameOf(server)) + " does not start again");
    }
  }
}

}  // namespace tessera::soak
