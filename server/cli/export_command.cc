// `tessera export RESULT --to FORMAT --out DIR`: writes a result in the formats of other programs.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/exporting/export_format.h"
#include "common/exporting/folder/export_folder.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/cli/export_job_command.h"
#include "server/client/interrupt.h"
#include "server/client/job_text.h"
#include "server/display/stage_line.h"

namespace tessera {
namespace {

struct ExportArguments {
  ExportRequest request;
  Endpoint coordinator;  // for jobs
  std::string color = "class", materials;
  bool quiet = false;
};

bool IsJob(const std::string& result) { return absl::StartsWith(result, "jobs/"); }

ExportOptions OptionsOf(const ExportArguments& arguments) {
  ExportOptions options = arguments.request.options;
  std::sort(options.formats.begin(), options.formats.end());
  options.formats.erase(std::unique(options.formats.begin(), options.formats.end()), options.formats.end());
  options.color = FindVertexColor(arguments.color).value_or(VertexColor::kClass);
  options.class_materials = !arguments.materials.empty();
  return options;
}

StatusOr<int> ExportJob(const ExportArguments& arguments) {
  for (const auto& [option, value] :
       {std::pair("--scene", arguments.request.scene), {"--start", arguments.request.start}}) {
    if (!value.empty()) {
      return InputError(option, "", value, "no such option for a job: the coordinator has its scene and start mesh");
    }
  }
  return ExportResultOfJob(arguments.coordinator, arguments.request.result, OptionsOf(arguments),
                           arguments.request.out);
}

StatusOr<std::vector<ExportedFormat>> ExportFiles(const ExportArguments& arguments, Warnings* warnings) {
  ExportRequest request = arguments.request;
  request.options = OptionsOf(arguments);
  StageLine line(!arguments.quiet);
  TaskControl control;
  control.report = [&](double fraction, const std::string& stage) { line.Show(fraction, stage); };
  control.cancelled = [] { return Interrupts() > 0; };
  return ExportFolder(request, warnings, control);
}

std::string FormatRows() {
  std::vector<std::vector<std::string>> rows;
  for (const ExportFormat& format : ExportFormats()) {
    rows.push_back({absl::StrCat("  ", std::string(format.name)), std::string(format.what)});
  }
  return ColumnsText(rows);
}

std::string ExportedText(const std::vector<ExportedFormat>& exported, const std::string& out) {
  std::vector<std::vector<std::string>> rows;
  for (const ExportedFormat& format : exported) {
    rows.push_back({format.name, absl::StrCat(format.files, format.files == 1 ? " file" : " files"),
                    absl::StrFormat("%.1f MB", static_cast<double>(format.bytes) / 1e6),
                    absl::StrCat(out, "/", format.name)});
  }
  return ColumnsText(rows);
}

}  // namespace

void AddExportCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<ExportArguments>();
  ExportRequest& request = arguments->request;
  CLI::App* command = app.add_subcommand("export", "Make files for other programs of a result");
  command
      ->add_option("RESULT", request.result,
                   "Folder of a result: OUT of `tessera run` or `tessera fetch`; or a job that has ended: jobs/1")
      ->required();
  command->add_option("--to", request.options.formats, "Formats, separated by commas (see below)")
      ->type_name("FORMAT,...")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->required();
  command->add_option("--out", request.out, "Folder for the files, new or empty")->type_name("DIR")->required();
  AddCoordinatorOption(*command, &arguments->coordinator);
  command
      ->add_option("--crs", request.options.crs,
                   "Reference system of the files: EPSG:H, EPSG:H+V, ENU:LAT,LON[,H] or local (default: that of the "
                   "block that was imported, else that of the scene)")
      ->type_name("CRS");
  command->add_option("--color", arguments->color, "Colours of vertices")
      ->check(CLI::IsMember({"class", "image", "confidence", "displacement"}))
      ->capture_default_str();
  command
      ->add_option("--scene", request.scene,
                   "Scene of the result: for photographs, the start mesh, and results of earlier versions")
      ->type_name("DIR");
  command->add_option("--start", request.start, "Start mesh, in the scene's coordinates (default: that of --scene)")
      ->type_name("MESH");
  command->add_option("--gsd", request.options.gsd_m, "Side of a pixel of rasters, metres (default: that of the scene)")
      ->type_name("M")
      ->check(CLI::PositiveNumber);
  command->add_option("--materials", arguments->materials, "Write a material per class: obj with an MTL file")
      ->check(CLI::IsMember({"class"}));
  command->add_flag("--quiet", arguments->quiet, "Print neither progress nor the summary table");
  command->footer(absl::StrCat(
      "Formats:\n", FormatRows(),
      "Files of a format are in DIR/FORMAT. They appear only when all are complete; DIR/export.json, the last, lists\n"
      "them with their SHA-256. The same result gives the same bytes. Other programs, formats and coordinate systems:\n"
      "common/exporting/README.md.\n"
      "Examples:\n"
      "  tessera export out --to changes --crs EPSG:25832 --out gis\n"
      "  tessera export out --to 3dtiles,glb --scene scene --out web\n"
      "  tessera export jobs/1 --to 3dtiles --out web\n"
      "  tessera export out --to obj --materials class --out retouch\n"
      "  tessera export out --to dsm,ortho --scene scene --gsd 0.1 --crs EPSG:25832+7837 --out rasters"));
  command->callback([arguments, exit_code] {
    if (IsJob(arguments->request.result)) {
      const StatusOr<int> code = ExportJob(*arguments);
      *exit_code = code.ok() ? *code : ReportError("export", code.status());
      return;
    }
    InstallInterruptCounter();
    Warnings warnings;
    const StatusOr<std::vector<ExportedFormat>> exported = ExportFiles(*arguments, &warnings);
    if (!exported.ok()) *exit_code = ReportError("export", exported.status());
    PrintWarnings(warnings);
    if (absl::IsAlreadyExists(exported.status())) *exit_code = kExitUsage;
    if (exported.ok() && !arguments->quiet) std::fputs(ExportedText(*exported, arguments->request.out).c_str(), stdout);
  });
}

}  // namespace tessera
