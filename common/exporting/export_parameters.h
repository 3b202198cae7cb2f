// Parameters and files of the tasks of kind export. An export runs in stages:
//
//   split ─► (color) ─► sheet ─► join
//
// split: one task writes the sheets of the result, of the start if a format reads it, and their views. color: a task a
// sheet. sheet: a task a sheet and format. join: a task a format. Only files in kExportFolder are delivered.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/exporting/sheet.h"

namespace tessera {

enum class ExportStage { kSplit, kColor, kSheet, kJoin };

struct ExportParameters {
  ExportStage stage = ExportStage::kSplit;
  std::string format = {};   // sheet, join: name of the ExportFormat
  std::string options = {};  // sheet, join: ExportOptionsToJson, of this format alone
  std::string scene = {};    // split: ExportSceneToJson, which it passes on as kExportSceneFile
  SheetId sheet = {};        // color, sheet
  // split, join: all sheets of the survey. color, sheet: the neighbours among the inputs. By y, then x.
  std::vector<SheetId> sheets = {};
  bool start = false;    // split, sheet: writes or reads the sheets of the start
  bool views = false;    // split, sheet: writes or reads the views of sheets
  bool colored = false;  // sheet, join: sheets are those of color
  bool changes = false;  // join: reads kChangesGeoJsonFile
  // sheet: itself, if some of its faces are of quarantined tiles. join: all such sheets. By y, then x.
  std::vector<SheetId> set_aside = {};
};

// Canonical JSON.
std::string ToJson(const ExportParameters& parameters);
// INVALID_ARGUMENT unless `json` is the canonical form.
StatusOr<ExportParameters> ParseExportParameters(const std::string& json);

// Files that the stages pass on; all are outputs of split but the last two.
inline constexpr char kExportSceneFile[] = "export-scene.json";  // ExportSceneToJson
inline constexpr char kSheetListFile[] = "sheets.json";          // SheetListToJson of the sheets with faces
std::string SheetFileName(const SheetId& id);                    // a sheet of the result
std::string StartSheetFileName(const SheetId& id);
std::string SheetViewsFileName(const SheetId& id);    // SheetViewsToJson
std::string ColoredSheetFileName(const SheetId& id);  // color: the sheet with colors
// sheet: kPartFile of the format.
std::string PartFileName(std::string_view format, const SheetId& id);

// Whether the output is a sheet or a part, which only later stages read. It may be removed when the job has ended, and
// is computed again if it is needed.
bool IsPassedOn(std::string_view output);

std::string SheetListToJson(const std::vector<SheetId>& sheets);
StatusOr<std::vector<SheetId>> ParseSheetList(const std::string& json);

// Where the files of a format are delivered: "export/FORMAT/".
std::string ExportFolderOf(std::string_view format);
// A sheet with more than one file delivers them in this stored zip archive, because a city has thousands of sheets;
// it is unpacked where results are fetched.
std::string SheetArchiveName(std::string_view format, const SheetId& id);
inline constexpr char kSheetArchiveEnding[] = ".zip";

}  // namespace tessera
