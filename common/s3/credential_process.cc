#include "common/s3/credential_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

Status ProcessError(const std::string& what) {
  return absl::FailedPreconditionError("the credential_process of the AWS profile " + what);
}

// Reads until the end of `fd`. DEADLINE_EXCEEDED and RESOURCE_EXHAUSTED at the limits.
StatusOr<std::string> ReadOutput(int fd, double seconds) {
  using std::chrono::steady_clock;
  const auto end = steady_clock::now() + std::chrono::duration<double>(seconds);
  std::string output;
  while (true) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - steady_clock::now()).count();
    pollfd wait = {fd, POLLIN, 0};
    const int ready = left <= 0 ? 0 : ::poll(&wait, 1, static_cast<int>(left));
    if (ready < 0 && errno == EINTR) continue;
    if (ready <= 0) return ProcessError(absl::StrCat("did not end within ", seconds, " s"));
    char bytes[4096];
    const ssize_t got = ::read(fd, bytes, sizeof(bytes));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return output;
    output.append(bytes, static_cast<size_t>(got));
    if (static_cast<int64_t>(output.size()) > kMaxCredentialBytes) {
      return ProcessError(absl::StrCat("wrote more than ", kMaxCredentialBytes, " bytes"));
    }
  }
}

}  // namespace

StatusOr<std::string> RunCredentialProcess(const std::string& command, double seconds) {
  int pipe_fds[2];
  if (::pipe2(pipe_fds, O_CLOEXEC) != 0) return ProcessError(absl::StrCat("got no pipe: ", std::strerror(errno)));
  const int null_fd = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
  const char* argv[] = {"sh", "-c", command.c_str(), nullptr};
  const pid_t pid = ::fork();
  if (pid == 0) {
    // Only async-signal-safe calls are allowed here: the parent has several threads.
    ::setpgid(0, 0);
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGPIPE}) ::signal(signal, SIG_DFL);
    sigset_t none;
    ::sigemptyset(&none);
    ::sigprocmask(SIG_SETMASK, &none, nullptr);
    ::dup2(null_fd, 0);
    ::dup2(pipe_fds[1], 1);
    ::execv("/bin/sh", const_cast<char**>(argv));
    ::_exit(127);
  }
  const int error = errno;
  ::close(pipe_fds[1]);
  ::close(null_fd);
  if (pid < 0) {
    ::close(pipe_fds[0]);
    return ProcessError(absl::StrCat("could not be started: ", std::strerror(error)));
  }
  ::setpgid(pid, pid);
  StatusOr<std::string> output = ReadOutput(pipe_fds[0], seconds);
  ::close(pipe_fds[0]);
  // A process that has closed its output is waited for; at a limit, it is killed with its children.
  if (!output.ok()) ::kill(-pid, SIGKILL);
  int wait_status = 0;
  while (::waitpid(pid, &wait_status, 0) < 0 && errno == EINTR) {
  }
  TESSERA_RETURN_IF_ERROR(output.status());
  if (WIFSIGNALED(wait_status)) return ProcessError(absl::StrCat("ended by signal ", WTERMSIG(wait_status)));
  if (WEXITSTATUS(wait_status) != 0) {
    return ProcessError(absl::StrCat("ended with exit code ", WEXITSTATUS(wait_status)));
  }
  return output;
}

}  // namespace tessera
