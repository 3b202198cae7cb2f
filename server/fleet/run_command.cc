#include "server/fleet/run_command.h"

#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "common/storage/files.h"
#include "server/client/child_process.h"

namespace tessera {
namespace {

constexpr auto kPoll = std::chrono::milliseconds(10);
constexpr int kErrorLines = 5;

// The path of a program as a shell finds it; its name if it is in no folder of PATH.
std::string ProgramPath(const std::string& name) {
  const char* const path = std::getenv("PATH");
  if (name.find('/') != std::string::npos || path == nullptr) return name;
  const std::vector<std::string> folders = absl::StrSplit(path, ':');
  for (const std::string& folder : folders) {
    const std::string candidate = absl::StrCat(folder.empty() ? "." : folder, "/", name);
    if (::access(candidate.c_str(), X_OK) == 0) return candidate;
  }
  return name;
}

}  // namespace

StatusOr<std::string> RunCommand(const std::vector<std::string>& words, const CommandLimits& limits) {
  using std::chrono::steady_clock;
  TESSERA_ASSIGN_OR_RETURN(const TempFolder folder, TempFolder::Create("", "tessera-command-"));
  const std::string output = folder.path() + "/output", errors = folder.path() + "/errors";
  TESSERA_ASSIGN_OR_RETURN(
      const auto child, ChildProcess::Start(ProgramPath(words[0]), {words.begin() + 1, words.end()}, output, errors));
  const auto size = [&] {
    const auto stamp = StampOf(output);
    return stamp.ok() ? stamp->size_bytes : 0;
  };
  const auto end = steady_clock::now() + std::chrono::duration<double>(limits.seconds);
  while (child->Running()) {          // a command that is still running at the return is killed
    if (steady_clock::now() > end) {  // not DEADLINE_EXCEEDED, which means that no coordinator answers
      return absl::AbortedError(absl::StrCat(words[0], " did not end within ", limits.seconds, " s"));
    }
    if (limits.stop()) return absl::CancelledError(absl::StrCat(words[0], " was interrupted"));
    if (size() > limits.bytes) break;
    std::this_thread::sleep_for(kPoll);
  }
  if (size() > limits.bytes) {
    return absl::ResourceExhaustedError(absl::StrCat(words[0], " wrote more than ", limits.bytes, " bytes"));
  }
  if (const std::string ended = child->ExitDescription(); ended != "exit code 0") {
    const std::string lines = LastLines(errors, kErrorLines);
    return absl::FailedPreconditionError(
        absl::StrCat(words[0], " ended with ", ended, lines.empty() ? "" : ":\n", lines));
  }
  return ReadFile(output, limits.bytes);
}

}  // namespace tessera
