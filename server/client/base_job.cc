#include "server/client/base_job.h"

#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr char kResultFile[] = "/result";

}  // namespace

Status WriteRunResult(const std::string& state_dir, const RunResult& result) {
  return WriteFileAtomic(state_dir + kResultFile, result.data_dir + "\n" + result.job + "\n");
}

StatusOr<RunResult> ResolveBaseJob(const std::string& base, const std::string& data_dir) {
  if (base.starts_with("jobs/")) {
    if (!data_dir.empty()) return RunResult{data_dir, base};
    return InputError("--base", "", "'" + base + "'",
                      "the folder with an earlier run's results, or --data with the state folder of this job");
  }
  const std::string folder = AbsolutePath(base);
  const StatusOr<std::string> text = ReadFile(folder + "/.tessera" + kResultFile, 1 << 16);
  const size_t end = text.ok() ? text->find('\n') : std::string::npos;
  if (end == std::string::npos) {
    return InputError(folder, "", "no result of a run with its state (.tessera)",
                      "a folder that `tessera run --out` wrote, or a job name such as jobs/1");
  }
  RunResult result = {AbsolutePath(text->substr(0, end)), text->substr(end + 1)};
  while (!result.job.empty() && result.job.back() == '\n') result.job.pop_back();
  if (!data_dir.empty() && data_dir != result.data_dir) {
    return InputError(folder, "", "a result whose state folder is " + result.data_dir,
                      "a result of " + data_dir + " (--data)");
  }
  return result;
}

}  // namespace tessera
