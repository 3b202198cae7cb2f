// `tessera import SOURCE --out SCENE`: makes a scene of a block of another program.
#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>

#include "absl/strings/str_cat.h"
#include "common/blocks/block_format.h"
#include "common/importing/import.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/interrupt.h"
#include "server/display/stage_line.h"

namespace tessera {
namespace {

struct ImportArguments {
  ImportOptions options;
  std::string out, json_file;
  std::vector<std::string> image_paths, flights;
  std::string format;
  std::string frame = "auto";
  double geoid_height_m = 0;
  bool quiet = false;
};

std::string FormatNames() {
  std::string names;
  for (const BlockFormat& format : BlockFormats())
    absl::StrAppend(&names, names.empty() ? "" : ", ", std::string(format.name));
  return names;
}

StatusOr<ImportResult> Import(ImportArguments arguments, Warnings* warnings) {
  ImportOptions& options = arguments.options;
  for (const std::string& text : arguments.image_paths) {
    TESSERA_ASSIGN_OR_RETURN(PathReplacement replacement, ParsePathReplacement(text));
    options.photographs.replacements.push_back(std::move(replacement));
  }
  for (const std::string& text : arguments.flights) {
    TESSERA_ASSIGN_OR_RETURN(FlightPattern flight, ParseFlightPattern(text));
    options.flights.push_back(std::move(flight));
  }
  StageLine line(!arguments.quiet);
  TaskControl control;
  control.report = [&](double fraction, const std::string& stage) { line.Show(fraction, stage); };
  control.cancelled = [] { return Interrupts() > 0; };
  return ImportScene(options, arguments.out, warnings, control);
}

}  // namespace

void AddImportCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<ImportArguments>();
  ImportOptions& options = arguments->options;
  CLI::App* command = app.add_subcommand("import", "Make a scene of a block of another program and its mesh");
  command->add_option("SOURCE", options.source, "File or folder of the block; its format is detected by its content")
      ->required();
  command->add_option("--out", arguments->out, "Folder of the scene, new or empty")->required();
  command->add_option("--mesh", options.mesh,
                      "Mesh: a PLY, OBJ or GLB, or a folder of tiles (default: that of an OpenDroneMap project)");
  CLI::Option* format =
      command->add_option("--format", arguments->format, absl::StrCat("Format of SOURCE: ", FormatNames()));
  command
      ->add_option("--images", options.photographs.folders, "Folder to search for the images (default: that of SOURCE)")
      ->type_name("DIR")
      ->allow_extra_args(false);
  command
      ->add_option("--image-path", arguments->image_paths,
                   "Replace the beginning OLD of the images' paths in SOURCE by NEW")
      ->type_name("OLD=NEW")
      ->allow_extra_args(false);
  command->add_flag("--copy", options.copy_images, "Copy the images (default: link to them)");
  command
      ->add_option("--crs", options.crs,
                   "Reference system of SOURCE where it names none or a wrong one: EPSG:H, EPSG:H+V, "
                   "ENU:LAT,LON[,H] or local")
      ->type_name("CRS");
  command
      ->add_option("--mesh-crs", options.mesh_crs,
                   "Reference system of the mesh (default: that of its metadata.xml, else that of SOURCE)")
      ->type_name("CRS");
  command
      ->add_option_function<std::string>(
          "--heights", [&options](const std::string&) { options.heights.ellipsoid = true; },
          "Take heights as above the ellipsoid, whatever the reference system says")
      ->check(CLI::IsMember({"ellipsoid"}));
  CLI::Option* geoid = command
                           ->add_option("--geoid-height", arguments->geoid_height_m,
                                        "Height of the geoid above the ellipsoid, for heights that PROJ has no "
                                        "grid for")
                           ->type_name("M");
  command
      ->add_option("--frame", arguments->frame,
                   "Frame of the scene: grid keeps the coordinates of a map projection, true converts to a local "
                   "east-north-up frame, auto takes the one that the tie points fit better")
      ->check(CLI::IsMember({"auto", "grid", "true"}))
      ->capture_default_str();
  command
      ->add_option("--labels", options.labels, "Classes of the mesh's faces: none, material, or property:NAME of a PLY")
      ->capture_default_str();
  command
      ->add_option("--classes", options.class_file,
                   "JSON object from names of materials or numbers of labels to names of classes")
      ->type_name("FILE");
  command->add_option("--component", options.component, "Component of SOURCE (default: the one with most images)")
      ->check(CLI::NonNegativeNumber);
  command->add_option("--flight", arguments->flights, "Images whose names match GLOB are flight NAME")
      ->type_name("NAME=GLOB")
      ->allow_extra_args(false);
  command->add_option("--max-error-px", options.max_error_px, "Largest median residual of the tie points")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_flag("--anyway", options.anyway, "Warn where images, poses and mesh do not fit, instead of refusing");
  command->add_option("--json", arguments->json_file, "Also write import.json to this file")->type_name("FILE");
  command->add_flag("--quiet", arguments->quiet, "Print neither progress nor the summary table");
  command->footer(
      "SOURCE and what to export there:\n"
      "  iTwin Capture, ContextCapture   block.xml or zipped .xmz, in the format BlocksExchange\n"
      "  Metashape, PhotoScan            cameras.xml (Export Cameras), or the .psz project\n"
      "  RealityScan                     folder of .xmp files, or the CSV of camera parameters\n"
      "  Pix4D                           folder 1_initial/params of the project\n"
      "  OpenDroneMap, OpenSfM           folder of the project\n"
      "  OpenMVS                         scene.mvs of an Interface command\n"
      "  COLMAP                          folder of the model\n"
      "  VisualSFM and others            .nvm\n"
      "import.json in SCENE says which conventions were applied, how they were proven, and what was left out.\n"
      "Examples:\n"
      "  tessera import block.xml --mesh Productions/Production_1 --out scene\n"
      "  tessera import cameras.xml --mesh model.obj --images /data/flight --out scene\n"
      "  tessera import block.xml --image-path 'D:\\flights=/data/flights' --mesh mesh.ply --out scene\n"
      "  tessera import project --out scene && tessera run scene --out out     an OpenDroneMap project");
  command->callback([arguments, format, geoid, exit_code] {
    InstallInterruptCounter();
    ImportOptions& given = arguments->options;
    if (format->count() > 0) given.format = arguments->format;
    if (geoid->count() > 0) given.heights.geoid_height_m = arguments->geoid_height_m;
    if (arguments->frame != "auto") given.frame = arguments->frame == "grid" ? FrameChoice::kGrid : FrameChoice::kTrue;
    Warnings warnings;
    StatusOr<ImportResult> result = Import(*arguments, &warnings);
    Status status = result.status();
    if (status.ok() && !arguments->json_file.empty()) status = WriteOutput(arguments->json_file, result->json);
    if (!status.ok()) *exit_code = ReportError("import", status);
    PrintWarnings(warnings);
    if (status.ok() && !arguments->quiet) std::cout << result->text << std::flush;
    if (absl::IsAlreadyExists(status)) *exit_code = kExitUsage;
    if (absl::IsFailedPrecondition(status)) *exit_code = kExitBadInput;
  });
}

}  // namespace tessera
