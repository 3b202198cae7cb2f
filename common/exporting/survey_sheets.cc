#include "common/exporting/survey_sheets.h"

#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/json_bounds.h"

namespace tessera {

std::vector<SurveySheet> SheetsOf(const Survey& survey) {
  std::map<std::pair<int, int>, std::pair<int64_t, std::set<int32_t>>> found;  // by y, then x
  for (const SurveyCell& cell : survey.cells) {
    const SheetId id = SheetOf({cell.x, cell.y});
    auto& [faces, views] = found[{id.y, id.x}];
    faces += cell.faces;
    views.insert(cell.views.begin(), cell.views.end());
  }
  std::vector<SurveySheet> sheets;
  for (const auto& [at, of_sheet] : found) {
    SurveySheet& sheet = sheets.emplace_back(SurveySheet{{at.second, at.first}, of_sheet.first, {}});
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

}  // namespace tessera
