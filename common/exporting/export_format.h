// The table of export formats. Planner, worker and command line read it.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/export_scene.h"
#include "common/exporting/sheet.h"
#include "common/scene/scene.h"

namespace tessera {

enum class VertexColor { kClass, kImage, kConfidence, kDisplacement };

// What a user asks of an export.
struct ExportOptions {
  std::vector<std::string> formats;  // names of ExportFormat, ascending
  std::string crs;                   // as ReferenceSystem::Parse reads it; empty: that of the scene's source
  VertexColor color = VertexColor::kClass;
  double gsd_m = 0;              // of rasters, metres; 0: the scene's GSD
  bool class_materials = false;  // obj: MTL and usemtl by class
  bool operator==(const ExportOptions&) const = default;
};

// One sheet, as the function of a format gets it. The members that the format's row does not ask for are empty.
struct SheetInput {
  const ExportScene& scene;
  const ExportOptions& options;
  SheetId id;
  Sheet sheet;                               // of the result; with colors if options.color is kImage
  std::vector<Sheet> neighbours = {};        // of the result, up to eight, by y, then x
  std::optional<Sheet> start = {};           // the same sheet of the start mesh, if it is known
  std::vector<SceneView> views = {};         // that may show the sheet
  std::vector<std::string> view_files = {};  // the path of each view's photograph
  std::vector<std::string> mask_files = {};  // the path of each view's mask; empty: none
  bool set_aside = false;                    // some of its faces are of tiles whose refinement failed
};

// All sheets, as the joining function of a format gets them.
struct JoinInput {
  const ExportScene& scene;
  const ExportOptions& options;
  struct Item {
    SheetId id;
    std::string sheet_path;  // of WriteSheet, if the row asks for sheets
    std::string part_path;   // kPartFile of the sheet's task, if the row has parts
    bool set_aside = false;
  };
  std::vector<Item> sheets = {};  // by y, then x
  std::string changes_path = {};  // changes.geojson of an update's result, if the row asks for it; empty: there is none
  Warnings* warnings = nullptr;   // gets what the user should know of the files; null: it is dropped
};

// A file that the function of a sheet writes for the joining function; it is not delivered.
inline constexpr char kPartFile[] = "part.arrays";

struct ExportFormat {
  std::string_view name;
  std::string_view what;           // for help texts
  bool reads_neighbours = false;   // SheetInput::neighbours
  bool reads_start = false;        // SheetInput::start
  bool reads_photographs = false;  // SheetInput::views
  bool on_globe = false;           // its coordinates are WGS 84, where the scene has a place there
  bool colored = false;            // it has vertex colours: SheetInput::sheet has colors if they are asked for
  bool has_part = false;           // the sheet's function writes kPartFile
  bool join_reads_sheets = false;  // JoinInput::Item::sheet_path
  bool reads_changes = false;      // JoinInput::changes_path; without it there is nothing to export
  // Writes the files of a sheet to `folder`, which exists; returns their names relative to it, without kPartFile. May
  // be null. The same input gives the same bytes.
  StatusOr<std::vector<std::string>> (*write_sheet)(const SheetInput&, const std::string& folder,
                                                    const TaskControl&) = nullptr;
  // Writes the files for all sheets together. Memory is bounded by a few sheets. May be null.
  StatusOr<std::vector<std::string>> (*join)(const JoinInput&, const std::string& folder, const TaskControl&) = nullptr;
  // Refuses before work what the format cannot write (CheckExport). May be null.
  Status (*check)(const ExportOptions&, const ExportScene&) = nullptr;
};

// All formats, by name.
std::span<const ExportFormat> ExportFormats();
// Null if `formats` has none of this name.
const ExportFormat* FindExportFormat(std::string_view name, std::span<const ExportFormat> formats = ExportFormats());

// INVALID_ARGUMENT with all unknown names, and if there is none.
Status CheckFormatNames(const ExportOptions& options, std::span<const ExportFormat> formats = ExportFormats());

// Refuses before work what cannot succeed. INVALID_ARGUMENT names every fault: an unknown format or none, a system for
// a scene without one, a missing grid, a gsd that is not positive, and what a format's check refuses.
Status CheckExport(const ExportOptions& options, const ExportScene& scene,
                   std::span<const ExportFormat> formats = ExportFormats());

// What the user should know before work: formats whose files will have no place on the globe.
Warnings ExportWarnings(const ExportOptions& options, const ExportScene& scene,
                        std::span<const ExportFormat> formats = ExportFormats());

// Canonical JSON of the options, part of task keys.
std::string ExportOptionsToJson(const ExportOptions& options);
StatusOr<ExportOptions> ParseExportOptions(const std::string& json);
// "class", "image", "confidence", "displacement".
std::string_view VertexColorName(VertexColor color);
std::optional<VertexColor> FindVertexColor(std::string_view name);

}  // namespace tessera
