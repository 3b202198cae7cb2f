// A child process.
#pragma once

#include <sys/types.h>

#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// The child has its own process group, so a terminal's Ctrl-C does not reach it. The kernel kills it when the thread
// that started it ends. Not thread-safe.
class ChildProcess {
 public:
  // Appends standard output to `log`, and errors to `errors`, or to `log` as well if it is empty. NOT_FOUND if the
  // program does not exist.
  static StatusOr<std::unique_ptr<ChildProcess>> Start(const std::string& program,
                                                       const std::vector<std::string>& arguments,
                                                       const std::string& log, const std::string& errors = "");
  // Kills the process group if the child still runs.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  pid_t pid() const { return pid_; }
  const std::string& log() const { return log_; }

  // Does not block.
  bool Running();
  // "exit code 1" or "signal 9 (Killed)"; empty while the child runs.
  std::string ExitDescription();
  // Sends SIGTERM.
  void Terminate();

 private:
  ChildProcess(pid_t pid, std::string log) : pid_(pid), log_(std::move(log)) {}

  const pid_t pid_;
  const std::string log_;
  bool ended_ = false;
  int wait_status_ = 0;
};

// The last lines of a log; empty if the file cannot be read.
std::string LastLines(const std::string& log, int count);

// The folder of this program's executable.
StatusOr<std::string> ProgramFolder();

}  // namespace tessera
