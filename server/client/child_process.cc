#include "server/client/child_process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "common/storage/files.h"

namespace tessera {

StatusOr<std::unique_ptr<ChildProcess>> ChildProcess::Start(const std::string& program,
                                                            const std::vector<std::string>& arguments,
                                                            const std::string& log, const std::string& errors) {
  if (::access(program.c_str(), X_OK) != 0) return absl::NotFoundError(program + ": found no executable program");
  constexpr int kAppend = O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC;
  const int log_fd = ::open(log.c_str(), kAppend, 0600);
  if (log_fd < 0) return absl::InternalError("cannot write " + log + ": " + std::strerror(errno));
  const std::string& errors_file = errors.empty() ? log : errors;
  const int errors_fd = ::open(errors_file.c_str(), kAppend, 0600);
  if (errors_fd < 0) {
    ::close(log_fd);
    return absl::InternalError("cannot write " + errors_file + ": " + std::strerror(errno));
  }
  const int null_fd = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
  std::vector<char*> argv = {const_cast<char*>(program.c_str())};
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  const pid_t parent = ::getpid();
  const pid_t pid = ::fork();
  if (pid == 0) {
    // Only async-signal-safe calls are allowed here: the parent has several threads.
    ::setpgid(0, 0);
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != parent) ::_exit(127);  // the parent ended before prctl
    for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGPIPE}) ::signal(signal, SIG_DFL);
    sigset_t none;
    ::sigemptyset(&none);
    ::sigprocmask(SIG_SETMASK, &none, nullptr);
    ::dup2(null_fd, 0);
    ::dup2(log_fd, 1);
    ::dup2(errors_fd, 2);
    ::execv(program.c_str(), argv.data());
    ::_exit(127);
  }
  const int error = errno;
  ::close(log_fd);
  ::close(errors_fd);
  ::close(null_fd);
  if (pid < 0) return absl::InternalError("cannot start " + program + ": " + std::strerror(error));
  ::setpgid(pid, pid);
  return std::unique_ptr<ChildProcess>(new ChildProcess(pid, log));
}

ChildProcess::~ChildProcess() {
  if (!Running()) return;
  ::kill(-pid_, SIGKILL);
  ::waitpid(pid_, &wait_status_, 0);
}

bool ChildProcess::Running() {
  if (ended_) return false;
  const pid_t got = ::waitpid(pid_, &wait_status_, WNOHANG);
  ended_ = got == pid_ || (got < 0 && errno == ECHILD);
  return !ended_;
}

std::string ChildProcess::ExitDescription() {
  if (Running()) return "";
  if (WIFSIGNALED(wait_status_)) {
    const int signal = WTERMSIG(wait_status_);
    return "signal " + std::to_string(signal) + " (" + strsignal(signal) + ")";
  }
  return "exit code " + std::to_string(WEXITSTATUS(wait_status_));
}

void ChildProcess::Terminate() {
  if (Running()) ::kill(pid_, SIGTERM);
}

std::string LastLines(const std::string& log, int count) {
  constexpr int64_t kTailBytes = 16 << 10;
  const auto stamp = StampOf(log);
  if (!stamp.ok()) return "";
  const int64_t offset = std::max<int64_t>(0, stamp->size_bytes - kTailBytes);
  const auto tail = ReadFileRange(log, offset, kTailBytes);
  if (!tail.ok()) return "";
  size_t start = tail->size();
  while (count > 0 && start > 0) {
    start = start >= 2 ? tail->rfind('\n', start - 2) : std::string::npos;
    if (start == std::string::npos) return *tail;
    ++start;
    --count;
  }
  return tail->substr(start);
}

StatusOr<std::string> ProgramFolder() {
  std::error_code error;
  const auto path = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) return absl::InternalError("cannot read /proc/self/exe: " + error.message());
  return path.parent_path().string();
}

}  // namespace tessera
