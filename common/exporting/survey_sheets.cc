#include "common/exporting/survey_sheets.h"

#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "common/base/json_bounds.h"
#include "common/base/printable.h"

namespace tessera {

std::vector<SurveySheet> SheetsOf(const Survey& survey) {
  std::map<SheetId, std::pair<int64_t, std::set<int32_t>>> found;
  for (const SurveyCell& cell : survey.cells) {
    const SheetId id = SheetOf({cell.x, cell.y});
    auto& [faces, views] = found[id];
    faces += cell.faces;
    views.insert(cell.views.begin(), cell.views.end());
  }
  std::vector<SurveySheet> sheets;
  for (const auto& [id, of_sheet] : found) {
    SurveySheet& sheet = sheets.emplace_back(SurveySheet{id, of_sheet.first, {}});
    for (const int32_t v : of_sheet.second) {
      if (!survey.views[v].withdrawn) sheet.views.push_back(v);
    }
  }
  return sheets;
}

std::string SheetViewsToJson(const Survey& survey, const SurveySheet& sheet) {
  std::vector<SceneView> views;
  for (const int32_t v : sheet.views) {
    views.push_back(survey.views[v]);
    views.back().likelihood_path.clear();  // exports read photographs alone
    views.back().likelihood_content.clear();
    views.back().likelihood_form = {};
  }
  return nlohmann::json{{"ids", sheet.views}, {"views", ViewsToJson(views)}}.dump();
}

StatusOr<SheetViews> ParseSheetViews(const std::string& json) {
  constexpr char kName[] = "views of a sheet";
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(kName, json));
  SheetViews found;
  std::string views;
  try {
    const nlohmann::json in = nlohmann::json::parse(json);
    found.ids = in.at("ids").get<std::vector<int32_t>>();
    views = in.at("views").get<std::string>();
  } catch (const nlohmann::json::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat(kName, ": ", error.what()));
  }
  TESSERA_ASSIGN_OR_RETURN(found.views, ParseViews(views));
  if (found.views.size() != found.ids.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat(kName, ": found ", found.ids.size(), " ids of ", found.views.size(), " views"));
  }
  return found;
}

std::string ViewNamesToJson(const Survey& survey) {
  nlohmann::json names = nlohmann::json::array(), sheets = nlohmann::json::object();
  for (const SceneView& view : survey.views) {
    if (view.name.empty()) return "{}";
    names.push_back(view.name);
  }
  // A text of indices: lists of numbers would take a line a number.
  for (const SurveySheet& sheet : SheetsOf(survey)) sheets[SheetName(sheet.id)] = absl::StrJoin(sheet.views, " ");
  return nlohmann::json{{"names", names}, {"sheets", sheets}}.dump(-1, ' ', false,
                                                                   nlohmann::json::error_handler_t::replace);
}

StatusOr<ViewNamesOfSheets> ParseViewNames(const std::string& json) {
  constexpr char kName[] = "views of sheets";
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(kName, json));
  ViewNamesOfSheets found;
  try {
    const nlohmann::json in = nlohmann::json::parse(json);
    const auto names = in.value("names", std::vector<std::string>());
    const nlohmann::json sheets = in.value("sheets", nlohmann::json::object());
    for (const auto& [sheet, views] : sheets.items()) {
      const std::vector<std::string> place = absl::StrSplit(sheet, '_');
      SheetId id;
      bool is_valid = place.size() == 2 && absl::SimpleAtoi(place[0], &id.x) && absl::SimpleAtoi(place[1], &id.y);
      std::vector<std::string>& of_sheet = found[id];
      for (const std::string& text :
           std::vector<std::string>(absl::StrSplit(views.get<std::string>(), ' ', absl::SkipEmpty()))) {
        size_t view = 0;
        is_valid = is_valid && absl::SimpleAtoi(text, &view) && view < names.size();
        if (is_valid) of_sheet.push_back(names[view]);
      }
      if (!is_valid) {
        return absl::InvalidArgumentError(absl::StrCat(kName, ": found sheet '", Printable(sheet),
                                                       "', expected X_Y with numbers of views below ", names.size()));
      }
    }
  } catch (const nlohmann::json::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat(kName, ": ", error.what()));
  }
  return found;
}

}  // namespace tessera
