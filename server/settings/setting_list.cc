#include "server/settings/setting_list.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "common/exporting/export_format.h"
#include "common/job/refine_steps.h"
#include "server/settings/job_settings.h"

namespace tessera {
namespace {

// "thin_plate" as "thinPlate".
std::string JsonName(const std::string& name) {
  std::string json;
  bool upper = false;
  for (const char c : name) {
    if (c != '_') json += upper && c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
    upper = c == '_';
  }
  return json;
}

std::map<std::string, std::string> ForAllMethods(const std::string& value) {
  std::map<std::string, std::string> defaults;
  for (const char* const method : kMethods) defaults[method] = value;
  return defaults;
}

ListedSetting Plain(const std::string& name, const std::string& field, const std::string& help, SettingKind kind,
                    const std::string& standard) {
  ListedSetting setting;
  setting.name = name;
  setting.field = field;
  setting.help = help;
  setting.kind = kind;
  setting.defaults = ForAllMethods(standard);
  return setting;
}

ListedSetting Within(ListedSetting setting, double minimum, std::optional<double> maximum,
                     const std::string& unit = "") {
  setting.minimum = minimum;
  setting.maximum = maximum;
  setting.unit = unit;
  return setting;
}

ListedSetting OneOf(ListedSetting setting, std::vector<std::string> choices) {
  setting.choices = std::move(choices);
  return setting;
}

template <class Row>
ListedSetting OfMethod(const Row& row, SettingKind kind) {
  ListedSetting setting = Plain(row.name, absl::StrCat("methodSettings.", JsonName(row.name)), row.meaning, kind, "");
  setting.defaults.clear();
  for (const char* const method : kMethods) {
    if (auto value = MethodDefault(row.name, method)) setting.defaults[method] = *std::move(value);
  }
  if (setting.name.ends_with("_px")) setting.unit = "px";
  return setting;
}

void AddMethodSettings(std::vector<ListedSetting>* list) {
  for (const auto& row : RealSettings()) {
    ListedSetting setting = OfMethod(row, SettingKind::kNumber);
    list->push_back(Within(setting, row.low, row.high, setting.unit));
  }
  for (const auto& row : WholeSettings()) {
    ListedSetting setting = OfMethod(row, SettingKind::kInteger);
    list->push_back(Within(setting, row.low, row.high, setting.unit));
  }
  for (const ListSetting& row : ListSettings()) {
    list->push_back(Within(OfMethod(row, SettingKind::kList), row.low, row.high));
  }
  for (const BoolSetting& row : BoolSettings()) list->push_back(OfMethod(row, SettingKind::kBoolean));
}

void AddExportSettings(std::vector<ListedSetting>* list) {
  std::vector<std::string> formats, colors;
  for (const ExportFormat& format : ExportFormats()) formats.emplace_back(format.name);
  for (const VertexColor color :
       {VertexColor::kClass, VertexColor::kImage, VertexColor::kConfidence, VertexColor::kDisplacement}) {
    colors.emplace_back(VertexColorName(color));
  }
  list->push_back(OneOf(
      Plain("formats", "export.formats", "Formats in which the result is also exported", SettingKind::kChoices, ""),
      std::move(formats)));
  list->push_back(Plain("export_crs", "export.crs",
                        "Coordinate reference system of exported files, EPSG:H[+V]; empty: that of the scene's source",
                        SettingKind::kText, ""));
  list->push_back(OneOf(
      Plain("color", "export.color", "What the vertex colours of exported files show", SettingKind::kChoice, "class"),
      std::move(colors)));
  list->push_back(Within(Plain("export_gsd", "export.gsdM", "Size of a pixel of exported rasters; 0: the scene's GSD",
                               SettingKind::kNumber, "0"),
                         0, std::nullopt, "m"));
  list->push_back(Plain("class_materials", "export.classMaterials", "Write a material for each class (obj)",
                        SettingKind::kBoolean, "false"));
}

}  // namespace

std::vector<ListedSetting> ListedSettings() {
  std::vector<ListedSetting> list;
  list.push_back(Within(Plain("tiles", "tiles", "Number of tiles; 1: untiled; 0: as many as tile_memory requires",
                              SettingKind::kInteger, "0"),
                        0, kMaxTiles));
  list.push_back(Within(Plain("tile_memory", "tileMemoryBytes",
                              "Largest memory of a worker for one tile, 128 MiB or more; larger tiles are split; 0: 4 "
                              "GiB, or no limit if the number of tiles is set",
                              SettingKind::kInteger, "0"),
                        0, static_cast<double>(kMaxTileMemory), "bytes"));
  list.push_back(OneOf(Plain("method", "method", "Method of refinement", SettingKind::kChoice, kMethods[0]),
                       {kMethods.begin(), kMethods.end()}));
  ListedSetting rounds =
      Plain("rounds", "rounds", "Rounds of geometry and labels; 0: the method's default", SettingKind::kInteger, "");
  for (auto& [method, value] : rounds.defaults) value = absl::StrCat(MethodRulesOf(method, 0, {}).rounds);
  list.push_back(Within(std::move(rounds), 0, kMaxRounds));
  AddMethodSettings(&list);
  list.push_back(Plain("classifier", "classifier",
                       "Source of class likelihoods: default (geometry and greenness), none (the scene's), or the "
                       "absolute path of a model on the coordinator's machine; empty: default if the scene has neither "
                       "likelihoods nor labels, else none",
                       SettingKind::kText, ""));
  list.push_back(Within(Plain("skip_images", "skipImages",
                              "Largest share of missing or broken images that are left out; 0: they are errors",
                              SettingKind::kNumber, "0"),
                        0, kMaxSkippedShare));
  list.push_back(Plain("anyway", "anyway", "Refine with a warning although images, poses and mesh do not fit",
                       SettingKind::kBoolean, "false"));
  list.push_back(Within(Plain("max_core_seconds", "maxCoreSeconds",
                              "Refuse the job if its predicted cost is higher; 0: no limit", SettingKind::kNumber, "0"),
                        0, std::nullopt, "core-seconds"));
  list.push_back(Plain("base", "update.base", "Update the result of this job, jobs/J, with the scene's new images",
                       SettingKind::kText, ""));
  list.push_back(Plain("withdraw", "update.withdraw", "Flights of the base job whose images are no longer used",
                       SettingKind::kTextList, ""));
  list.push_back(Plain("all_epochs", "update.allEpochs",
                       "Use all images; else older images are left out where the newest flight covers the ground",
                       SettingKind::kBoolean, "false"));
  list.push_back(Plain("from_scratch", "update.fromScratch",
                       "Refine changed tiles, and those that depend on them, from the start mesh",
                       SettingKind::kBoolean, "false"));
  AddExportSettings(&list);
  return list;
}

}  // namespace tessera
