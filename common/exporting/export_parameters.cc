#include "common/exporting/export_parameters.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/base/json_bounds.h"
#include "common/job/task_parameters.h"

namespace tessera {
namespace {

constexpr std::string_view kSheetsFolder = "sheets", kStartFolder = "start", kColoredFolder = "colored",
                           kPartsFolder = "parts";
constexpr std::array<std::string_view, 4> kStageNames = {"split", "color", "sheet", "join"};

nlohmann::json SheetsJson(const std::vector<SheetId>& sheets) {
  nlohmann::json json = nlohmann::json::array();
  for (const SheetId& id : sheets) json.push_back({id.x, id.y});
  return json;
}

SheetId SheetFromJson(const nlohmann::json& json) { return {json.at(0).get<int>(), json.at(1).get<int>()}; }

std::vector<SheetId> SheetsFromJson(const nlohmann::json& json) {
  std::vector<SheetId> sheets;
  for (const nlohmann::json& id : json) sheets.push_back(SheetFromJson(id));
  return sheets;
}

std::string SheetFileIn(std::string_view folder, const SheetId& id, std::string_view ending) {
  return absl::StrCat(std::string(folder), "/", SheetName(id), std::string(ending));
}

}  // namespace

std::string ToJson(const ExportParameters& p) {
  nlohmann::json json = {{"stage", std::string(kStageNames[static_cast<size_t>(p.stage)])}};
  if (!p.format.empty()) json["format"] = p.format;
  if (!p.options.empty()) json["options"] = p.options;
  if (!p.scene.empty()) json["scene"] = p.scene;
  if (p.stage == ExportStage::kColor || p.stage == ExportStage::kSheet) json["sheet"] = {p.sheet.x, p.sheet.y};
  if (!p.sheets.empty()) json["sheets"] = SheetsJson(p.sheets);
  if (p.start) json["start"] = true;
  if (p.views) json["views"] = true;
  if (p.colored) json["colored"] = true;
  if (p.changes) json["changes"] = true;
  if (!p.set_aside.empty()) json["set_aside"] = SheetsJson(p.set_aside);
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

StatusOr<ExportParameters> ParseExportParameters(const std::string& text) {
  constexpr char kName[] = "parameters of export";
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(kName, text));
  ExportParameters p;
  try {
    const nlohmann::json json = nlohmann::json::parse(text);
    const auto stage = std::find(kStageNames.begin(), kStageNames.end(), json.at("stage").get<std::string>());
    if (stage == kStageNames.end()) {
      return absl::InvalidArgumentError(absl::StrCat(kName, ": stage: expected split, color, sheet or join"));
    }
    p.stage = static_cast<ExportStage>(stage - kStageNames.begin());
    p.format = json.value("format", std::string());
    p.options = json.value("options", std::string());
    p.scene = json.value("scene", std::string());
    if (json.contains("sheet")) p.sheet = SheetFromJson(json.at("sheet"));
    if (json.contains("sheets")) p.sheets = SheetsFromJson(json.at("sheets"));
    p.start = json.value("start", false);
    p.views = json.value("views", false);
    p.colored = json.value("colored", false);
    p.changes = json.value("changes", false);
    if (json.contains("set_aside")) p.set_aside = SheetsFromJson(json.at("set_aside"));
  } catch (const nlohmann::json::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat(kName, ": ", error.what()));
  }
  // Rejects unknown keys, numbers that are not integers or out of range, and other formatting.
  if (ToJson(p) != text) {
    return absl::InvalidArgumentError(
        absl::StrCat(kName, ": found another form than the canonical JSON of this version"));
  }
  return p;
}

std::string SheetFileName(const SheetId& id) { return SheetFileIn(kSheetsFolder, id, ".arrays"); }
std::string StartSheetFileName(const SheetId& id) { return SheetFileIn(kStartFolder, id, ".arrays"); }
std::string SheetViewsFileName(const SheetId& id) { return SheetFileIn("sheet-views", id, ".json"); }
std::string ColoredSheetFileName(const SheetId& id) { return SheetFileIn(kColoredFolder, id, ".arrays"); }
std::string PartFileName(std::string_view format, const SheetId& id) {
  return SheetFileIn(absl::StrCat(std::string(kPartsFolder), "/", std::string(format)), id, ".arrays");
}

bool IsPassedOn(std::string_view output) {
  const std::string_view folder = output.substr(0, output.find('/'));
  return folder != output &&
         (folder == kSheetsFolder || folder == kStartFolder || folder == kColoredFolder || folder == kPartsFolder);
}

std::string SheetListToJson(const std::vector<SheetId>& sheets) { return SheetsJson(sheets).dump(); }

StatusOr<std::vector<SheetId>> ParseSheetList(const std::string& text) {
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(kSheetListFile, text));
  try {
    return SheetsFromJson(nlohmann::json::parse(text));
  } catch (const nlohmann::json::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat(kSheetListFile, ": ", error.what()));
  }
}

std::string ExportFolderOf(std::string_view format) { return absl::StrCat(kExportFolder, std::string(format), "/"); }

std::string SheetArchiveName(std::string_view format, const SheetId& id) {
  return absl::StrCat(ExportFolderOf(format), SheetName(id), kSheetArchiveEnding);
}

}  // namespace tessera
