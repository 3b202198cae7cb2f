#include "common/exporting/export_format.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/base/json_bounds.h"
#include "common/exporting/export_map.h"
#include "common/exporting/tiles3d/tiles3d.h"

namespace tessera {
namespace {

// By name.
constexpr std::array<ExportFormat, 1> kExportFormats = {
    {{.name = "3dtiles",
      .what = "3D Tiles 1.1: levels of detail as GLB, placed on the globe; for Cesium, Unreal and web viewers",
      .reads_start = true,
      .colored = true,
      .has_part = true,
      .write_sheet = WriteTiles3dSheet,
      .join = JoinTiles3d}}};

constexpr std::array<std::string_view, 4> kVertexColors = {"class", "image", "confidence", "displacement"};

std::string FormatNames() {
  std::string names;
  for (const ExportFormat& format : ExportFormats())
    absl::StrAppend(&names, names.empty() ? "" : ", ", std::string(format.name));
  return names;
}

}  // namespace

std::span<const ExportFormat> ExportFormats() { return kExportFormats; }

const ExportFormat* FindExportFormat(std::string_view name) {
  const auto formats = ExportFormats();
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

Status CheckExport(const ExportOptions& options, const ExportScene& scene) {
  Faults faults;
  if (options.formats.empty()) {
    faults.Add(absl::InvalidArgumentError("formats: found none, expected some of " + FormatNames()));
  }
  for (const std::string& name : options.formats) {
    if (FindExportFormat(name) != nullptr) continue;
    faults.Add(
        absl::InvalidArgumentError(absl::StrCat("formats: found '", name, "', expected some of ", FormatNames())));
  }
  if (!(options.gsd_m >= 0) || !std::isfinite(options.gsd_m)) {
    faults.Add(absl::InvalidArgumentError(
        absl::StrCat("gsd: found ", options.gsd_m, ", expected a positive number of metres")));
  }
  const StatusOr<ExportMap> map = ExportMap::Open(scene, options.crs);
  if (!map.ok()) faults.Add(map.status());
  return faults.ToStatus();
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
