// The sheets of a city, as planning knows them.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/exporting/sheet.h"
#include "common/job/survey.h"
#include "common/scene/scene.h"

namespace tessera {

struct SurveySheet {
  SheetId id;
  int64_t faces = 0;           // of the start mesh
  std::vector<int32_t> views;  // that its cells chose, ascending
};

// The sheets with ground cells, by y, then x. Withdrawn views are not listed.
std::vector<SurveySheet> SheetsOf(const Survey& survey);

// The views that may show a sheet.
struct SheetViews {
  std::vector<int32_t> ids;      // indices of the survey, ascending
  std::vector<SceneView> views;  // with the hashes of their pixels, so that equal bytes mean equal photographs
};
// `survey`: the plain one (WithoutNames), so that renamed files give the same bytes.
std::string SheetViewsToJson(const Survey& survey, const SurveySheet& sheet);
// INVALID_ARGUMENT if `json` is not what SheetViewsToJson writes.
StatusOr<SheetViews> ParseSheetViews(const std::string& json);

// Names of the views of each sheet with ground cells.
using ViewNamesOfSheets = std::map<SheetId, std::vector<std::string>>;
// JSON; report.json holds it as "views_of_sheets", so that an export of a result's folder takes the photographs that
// one of the job takes. "{}" if the survey has no names.
std::string ViewNamesToJson(const Survey& survey);
// INVALID_ARGUMENT if `json` is not what ViewNamesToJson writes.
StatusOr<ViewNamesOfSheets> ParseViewNames(const std::string& json);

}  // namespace tessera
