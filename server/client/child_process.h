// A program that this one started and answers for.
#ifndef TESSERA_SERVER_CLIENT_CHILD_PROCESS_H_
#define TESSERA_SERVER_CLIENT_CHILD_PROCESS_H_

#include <sys/types.h>

#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// In a process group of its own, so that a terminal's Ctrl-C does not reach it; killed by the system if the thread that
// started it ends. Not thread-safe.
class ChildProcess {
 public:
  // Output and errors go to the end of `log`. NOT_FOUND if there is no such program.
  static StatusOr<std::unique_ptr<ChildProcess>> Start(const std::string& program,
                                                       const std::vector<std::string>& arguments,
                                                       const std::string& log);
  // Kills what still runs, the whole group.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  pid_t pid() const { return pid_; }
  const std::string& log() const { return log_; }

  // Does not wait.
  bool Running();
  // How it ended: "exit code 1", "signal 9 (Killed)"; empty while it runs.
  std::string HowItEnded();
  // Asks it to end.
  void Terminate();

 private:
  ChildProcess(pid_t pid, std::string log) : pid_(pid), log_(std::move(log)) {}

  const pid_t pid_;
  const std::string log_;
  bool ended_ = false;
  int wait_status_ = 0;
};

// The last lines of a log; empty if there is none.
std::string LastLines(const std::string& log, int count);

// The folder that this program's executable lies in.
StatusOr<std::string> ProgramFolder();

}  // namespace tessera

#endif  // TESSERA_SERVER_CLIENT_CHILD_PROCESS_H_
