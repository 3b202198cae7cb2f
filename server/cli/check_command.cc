// `tessera check SCENE`: checks that a scene is ready for a job.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <mutex>

#include "common/scene/check.h"
#include "common/storage/files.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"

namespace tessera {
namespace {

struct CheckOptions {
  std::string scene;
  std::string json_file;
};

// One line on a terminal, redrawn in place; prints nothing elsewhere.
class ProgressLine {
 public:
  explicit ProgressLine(const char* what) : what_(what), on_terminal_(isatty(STDERR_FILENO) != 0) {}
  ~ProgressLine() { Clear(); }
  void Show(double fraction, const std::string& stage) {
    if (!on_terminal_) return;
    const std::lock_guard<std::mutex> lock(mutex_);
    std::fprintf(stderr, "\r\033[K%s %3.0f %% %s", what_, 100 * fraction, stage.c_str());
    shown_ = true;
  }
  void Clear() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (shown_) std::fputs("\r\033[K", stderr);
    shown_ = false;
  }

 private:
  const char* what_;
  bool on_terminal_;
  bool shown_ = false;
  std::mutex mutex_;
};

int RunCheck(const CheckOptions& options) {
  Warnings warnings;
  ProgressLine progress("checking");
  TaskControl control;
  control.report = [&](double fraction, const std::string& stage) { progress.Show(fraction, stage); };
  const StatusOr<SceneSummary> summary = CheckSceneFolder(options.scene, &warnings, control);
  progress.Clear();
  PrintWarnings(warnings);
  if (!summary.ok()) {
    std::fprintf(stderr, "%s\n", PrintableLines(std::string(summary.status().message())).c_str());
    return absl::IsInvalidArgument(summary.status()) ? kExitBadInput : kExitFailed;
  }
  std::fputs(PrintableLines(SummaryToText(*summary)).c_str(), stdout);
  if (!options.json_file.empty()) {
    const Status written = WriteFileAtomic(options.json_file, SummaryToJson(*summary, warnings));
    if (!written.ok()) {
      std::fprintf(stderr, "%s\n", PrintableLines(std::string(written.message())).c_str());
      return kExitFailed;
    }
  }
  return kExitOk;
}

}  // namespace

void AddCheckCommand(CLI::App& app, int* exit_code) {
  auto options = std::make_shared<CheckOptions>();
  CLI::App* command = app.add_subcommand("check", "Check that a scene is ready for a job");
  command->add_option("SCENE", options->scene, "Folder with a scene.json, or the scene.json itself")->required();
  command->add_option("--json", options->json_file, "Also write the summary to this file, as JSON");
  command->footer(
      "Reads the whole scene, with images and mesh, and prints a summary, or every fault that it has.\n"
      "Exit code: 0 valid, 1 failed, 3 the scene has faults.\n"
      "Example:\n"
      "  tessera check city --json summary.json");
  command->callback([options, exit_code] { *exit_code = RunCheck(*options); });
}

}  // namespace tessera
