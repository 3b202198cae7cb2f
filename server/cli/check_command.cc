// `tessera check SCENE`: checks that a scene is ready for a job.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>

#include "absl/strings/str_format.h"
#include "common/base/machine_limits.h"
#include "common/check/check.h"
#include "common/storage/files.h"
#include "server/admission/scene_reader.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/display/stage_line.h"
#include "server/tiling/quote.h"
#include "server/tiling/scene_survey.h"

namespace tessera {
namespace {

struct CheckOptions {
  std::string scene;
  std::string json_file;
  JobSettings settings;
};

// What planning a job would refuse, from an estimate of its survey: images without pairs, too little memory. Warns of
// tiles that this machine has no memory for.
Status JudgePlan(const JobSettings& settings, const CheckedScene& checked, Warnings* warnings) {
  TESSERA_ASSIGN_OR_RETURN(const TriangleMesh mesh, LoadSceneMesh(checked.scene, 0));
  const Survey survey = EstimateSurvey(checked.scene, mesh, checked.summary.gsd_m);
  TESSERA_RETURN_IF_ERROR(CheckPairs(settings, survey));
  TESSERA_ASSIGN_OR_RETURN(const Quote quote, MakeQuote(settings, survey));
  int64_t peak_bytes = 0;
  for (const TileQuote& tile : quote.tiles) peak_bytes = std::max(peak_bytes, tile.Total().peak_bytes);
  constexpr double kGiB = 1 << 30;
  if (peak_bytes > MemoryLimit_bytes()) {
    warnings->push_back(absl::StrFormat(
        "a tile needs about %.1f GiB, more than the %.1f GiB of this machine: run it with --tile-memory %.0fGiB or on "
        "a larger one",
        static_cast<double>(peak_bytes) / kGiB, static_cast<double>(MemoryLimit_bytes()) / kGiB,
        std::max(1.0, std::floor(static_cast<double>(MemoryLimit_bytes()) / kGiB / 2))));
  }
  return absl::OkStatus();
}

StatusOr<SceneSummary> Check(const CheckOptions& options, const TaskControl& control, Warnings* warnings) {
  SceneLoadOptions load;
  load.skip_images = options.settings.skip_images;
  load.anyway = options.settings.anyway;
  // As a job: a scene without likelihoods and labels gets the default classifier.
  SceneRequest request;
  request.skip_images = load.skip_images;
  const StatusOr<SceneListing> listing = ReadScene(options.scene, request, AllowedFiles::All());
  load.to_be_classified = load.by_default_rule = listing.ok() && !listing->classifier.empty();
  TESSERA_ASSIGN_OR_RETURN(CheckedScene checked,
                           CheckScene(options.scene, load, std::numeric_limits<int64_t>::max(), warnings, control));
  if (checked.summary.gsd_m > 0) TESSERA_RETURN_IF_ERROR(JudgePlan(options.settings, checked, warnings));
  return std::move(checked.summary);
}

int RunCheck(const CheckOptions& options) {
  Warnings warnings;
  StatusOr<SceneSummary> summary = absl::InternalError("not checked");
  {
    StageLine line(/*enabled=*/true);
    TaskControl control;
    control.report = [&](double fraction, const std::string& stage) { line.Show(fraction, stage); };
    summary = Check(options, control, &warnings);
  }
  if (!summary.ok()) std::fprintf(stderr, "%s\n", PrintableLines(std::string(summary.status().message())).c_str());
  PrintWarnings(warnings);
  if (summary.ok()) std::fputs(PrintableLines(SummaryToText(*summary)).c_str(), stdout);
  if (!options.json_file.empty()) {
    const Status written = WriteFileAtomic(options.json_file, summary.ok() ? SummaryToJson(*summary, warnings)
                                                                           : RefusalToJson(summary.status(), warnings));
    if (!written.ok()) {
      std::fprintf(stderr, "%s\n", PrintableLines(std::string(written.message())).c_str());
      return kExitFailed;
    }
  }
  if (summary.ok()) return kExitOk;
  return absl::IsInvalidArgument(summary.status()) ? kExitBadInput : kExitFailed;
}

}  // namespace

void AddCheckCommand(CLI::App& app, int* exit_code) {
  auto options = std::make_shared<CheckOptions>();
  CLI::App* command = app.add_subcommand("check", "Check that a scene is ready for a job");
  command->add_option("SCENE", options->scene, "Folder with a scene.json, or the scene.json itself")->required();
  AddSceneOptions(*command, &options->settings.skip_images, &options->settings.anyway);
  AddTileOptions(*command, &options->settings);
  command->add_option("--json", options->json_file, "Also write the summary, or the errors, to this file, as JSON");
  command->footer(
      "Reads the whole scene, with images and mesh, and prints a summary, or every fault that it has. Judges it as a\n"
      "job does: a scene that passes with the same options is not refused by `tessera run`.\n"
      "Exit code: 0 valid, 1 failed, 3 the scene has faults.\n"
      "Examples:\n"
      "  tessera check city --json summary.json\n"
      "  tessera check city --skip-images 0.1      missing and broken images are left out, at most 10 %");
  command->callback([options, exit_code] { *exit_code = RunCheck(*options); });
}

}  // namespace tessera
