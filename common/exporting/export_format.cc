#include "common/exporting/export_format.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/base/json_bounds.h"
#include "common/exporting/changes/changes_format.h"
#include "common/exporting/export_map.h"
#include "common/exporting/mesh_files/glb_export.h"
#include "common/exporting/mesh_files/ply_export.h"
#include "common/exporting/obj/obj_format.h"
#include "common/exporting/raster/ortho_sheet.h"
#include "common/exporting/raster/raster_formats.h"
#include "common/exporting/tiles3d/tiles3d.h"
#include "common/geodesy/reference_system.h"

namespace tessera {
namespace {

// By name.
constexpr ExportFormat kExportFormats[] = {
    {.name = "3dtiles",
     .what = "3D Tiles 1.1: levels of detail as GLB, on the globe; for Cesium, Unreal and web viewers",
     .reads_start = true,
     .on_globe = true,
     .colored = true,
     .has_part = true,
     .write_sheet = WriteTiles3dSheet,
     .join = JoinTiles3d},
    {.name = "changes", .what = "changed areas of an update, GeoJSON", .reads_changes = true, .join = JoinChanges},
    {.name = "classes",
     .what = "classes of the surface from above, GeoTIFF",
     .reads_neighbours = true,
     .has_part = true,
     .write_sheet = WriteClassesSheet,
     .join = JoinClasses,
     .check = CheckClassesRaster},
    {.name = "dsm",
     .what = "heights of the surface, GeoTIFF",
     .reads_neighbours = true,
     .has_part = true,
     .write_sheet = WriteDsmSheet,
     .join = JoinDsm,
     .check = CheckRaster},
    {.name = "glb",
     .what = "one binary glTF of at most 4 million triangles",
     .colored = true,
     .has_part = true,
     .write_sheet = WriteGlbPart,
     .join = JoinGlb},
    {.name = "obj",
     .what = "OBJ files with the tiles, system and offset of the source, to be textured there",
     .has_part = true,
     .write_sheet = WriteObjSheet,
     .join = JoinObj,
     .check = CheckObjExport},
    {.name = "ortho",
     .what = "true orthophoto of the surface, GeoTIFF",
     .reads_neighbours = true,
     .reads_photographs = true,
     .has_part = true,
     .write_sheet = WriteOrthoSheet,
     .join = JoinOrtho,
     .check = CheckRaster},
    {.name = "ply",
     .what = "one PLY with labels and colours of vertices and faces",
     .colored = true,
     .join_reads_sheets = true,
     .join = JoinPly},
};

constexpr std::array<std::string_view, 4> kVertexColors = {"class", "image", "confidence", "displacement"};

std::string FormatNames(std::span<const ExportFormat> formats) {
  std::string names;
  for (const ExportFormat& format : formats)
    absl::StrAppend(&names, names.empty() ? "" : ", ", std::string(format.name));
  return names;
}

// What is not exact in the way from a map projection to the globe: a missing grid, heights that are kept.
Warnings PlaceWarnings(const Frame& frame) {
  if (frame.crs().kind != Crs::Kind::kProjected) return {};
  StatusOr<ReferenceSystem> system = ReferenceSystem::Of(frame.crs());
  const StatusOr<Eigen::Vector3d> origin = frame.GeodeticFromLocal(Eigen::Vector3d::Zero());
  if (!system.ok() || !origin.ok() || !system->LocateGeodetic(*origin).ok()) return {};  // CheckExport refuses it
  return system->warnings();
}

}  // namespace

std::span<const ExportFormat> ExportFormats() { return kExportFormats; }

const ExportFormat* FindExportFormat(std::string_view name, std::span<const ExportFormat> formats) {
  const auto found =
      std::find_if(formats.begin(), formats.end(), [&](const ExportFormat& f) { return f.name == name; });
  return found == formats.end() ? nullptr : &*found;
}

std::string_view VertexColorName(VertexColor color) { return kVertexColors[static_cast<size_t>(color)]; }

std::optional<VertexColor> FindVertexColor(std::string_view name) {
  const auto found = std::find(kVertexColors.begin(), kVertexColors.end(), name);
  if (found == kVertexColors.end()) return std::nullopt;
  return static_cast<VertexColor>(found - kVertexColors.begin());
}

Status CheckFormatNames(const ExportOptions& options, std::span<const ExportFormat> formats) {
  Faults faults;
  if (options.formats.empty()) {
    faults.Add(absl::InvalidArgumentError("formats: found none, expected some of " + FormatNames(formats)));
  }
  for (const std::string& name : options.formats) {
    if (FindExportFormat(name, formats) != nullptr) continue;
    faults.Add(absl::InvalidArgumentError(
        absl::StrCat("formats: found '", name, "', expected some of ", FormatNames(formats))));
  }
  return faults.ToStatus();
}

Status CheckExport(const ExportOptions& options, const ExportScene& scene, std::span<const ExportFormat> formats) {
  Faults faults;
  faults.Add(CheckFormatNames(options, formats));
  if (!(options.gsd_m >= 0) || !std::isfinite(options.gsd_m)) {
    faults.Add(absl::InvalidArgumentError(
        absl::StrCat("gsd: found ", options.gsd_m, ", expected a positive number of metres")));
  }
  const StatusOr<ExportMap> map = ExportMap::Open(scene, options.crs);
  if (!map.ok()) faults.Add(map.status());
  if (!faults.empty()) return faults.ToStatus();
  Status last;  // formats may refuse an option with the same words
  for (const std::string& name : options.formats) {
    const ExportFormat& format = *FindExportFormat(name, formats);
    const Status status = format.check == nullptr ? absl::OkStatus() : format.check(options, scene);
    if (status != last) faults.Add(status);
    last = status;
  }
  return faults.ToStatus();
}

Warnings ExportWarnings(const ExportOptions& options, const ExportScene& scene, std::span<const ExportFormat> formats) {
  Warnings warnings;
  for (const std::string& name : options.formats) {
    const ExportFormat* const format = FindExportFormat(name, formats);
    if (format == nullptr || !format->on_globe) continue;
    if (scene.frame.crs().kind == Crs::Kind::kLocal) {
      warnings.push_back(absl::StrCat(name,
                                      ": the scene has no coordinate reference system, so that its files have no "
                                      "place on the globe: set `crs` in scene.json"));
    }
    for (const std::string& doubt : PlaceWarnings(scene.frame)) warnings.push_back(absl::StrCat(name, ": ", doubt));
  }
  return warnings;
}

std::string ExportOptionsToJson(const ExportOptions& options) {
  const nlohmann::json json = {{"formats", options.formats},
                               {"crs", options.crs},
                               {"color", std::string(VertexColorName(options.color))},
                               {"gsd_m", options.gsd_m},
                               {"class_materials", options.class_materials}};
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

StatusOr<ExportOptions> ParseExportOptions(const std::string& json) {
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth("export options", json));
  try {
    const nlohmann::json in = nlohmann::json::parse(json);
    ExportOptions options;
    options.formats = in.at("formats").get<std::vector<std::string>>();
    options.crs = in.at("crs");
    options.gsd_m = in.at("gsd_m");
    options.class_materials = in.at("class_materials");
    const std::optional<VertexColor> color = FindVertexColor(in.at("color").get<std::string>());
    if (!color)
      return absl::InvalidArgumentError("export options: color: expected class, image, confidence or displacement");
    options.color = *color;
    return options;
  } catch (const nlohmann::json::exception& error) {
    return absl::InvalidArgumentError(std::string("export options: ") + error.what());
  }
}

}  // namespace tessera
