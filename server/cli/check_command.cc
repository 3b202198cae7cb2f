// `tessera check SCENE`: checks that a scene is ready for a job.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "common/scene/check.h"
#include "common/storage/files.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/display/stage_line.h"

namespace tessera {
namespace {

struct CheckOptions {
  std::string scene;
  std::string json_file;
};

int RunCheck(const CheckOptions& options) {
  Warnings warnings;
  StatusOr<SceneSummary> summary = absl::InternalError("not checked");
  {
    StageLine line(/*enabled=*/true);
    TaskControl control;
    control.report = [&](double fraction, const std::string& stage) { line.Show(fraction, stage); };
    summary = CheckSceneFolder(options.scene, &warnings, control);
  }
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
