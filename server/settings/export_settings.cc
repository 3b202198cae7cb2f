#include "server/settings/export_settings.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <optional>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/exporting/export_map.h"
#include "common/exporting/sheet.h"

namespace tessera {
namespace {

constexpr size_t kMaxShownBytes = 60;

// The values as they are; a colour that does not exist counts as class.
ExportOptions Converted(const ExportSettings& settings) {
  ExportOptions options;
  options.formats = settings.formats;
  std::sort(options.formats.begin(), options.formats.end());
  options.formats.erase(std::unique(options.formats.begin(), options.formats.end()), options.formats.end());
  options.crs = settings.crs;
  options.gsd_m = settings.gsd_m;
  options.class_materials = settings.class_materials;
  if (!settings.color.empty()) options.color = FindVertexColor(settings.color).value_or(VertexColor::kClass);
  return options;
}

}  // namespace

StatusOr<ExportOptions> ExportOptionsOf(const ExportSettings& settings) {
  Faults faults;
  const ExportOptions options = Converted(settings);
  ExportOptions without_crs = options;  // the system can be checked only with the scene
  without_crs.crs.clear();
  faults.Add(CheckExport(without_crs, ExportScene()));
  if (!settings.color.empty() && !FindVertexColor(settings.color)) {
    faults.Add(
        absl::InvalidArgumentError(absl::StrCat("color: found '", Printable(Prefix(settings.color, kMaxShownBytes)),
                                                "', expected class, image, confidence or displacement")));
  }
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return options;
}

Status CheckExports(const JobSettings& settings, const ExportScene& scene) {
  if (settings.exports.formats.empty()) return absl::OkStatus();
  TESSERA_ASSIGN_OR_RETURN(const ExportOptions options, ExportOptionsOf(settings.exports));
  return CheckExport(options, scene);
}

Warnings WarningsOfExports(const JobSettings& settings, const ExportScene& scene) {
  return ExportWarnings(Converted(settings.exports), scene);
}

Status CheckExports(const JobSettings& settings, const Survey& survey) {
  if (settings.exports.formats.empty()) return absl::OkStatus();
  TESSERA_ASSIGN_OR_RETURN(const ExportScene scene, ExportSceneOf(survey));
  TESSERA_RETURN_IF_ERROR(CheckExports(settings, scene));
  TESSERA_ASSIGN_OR_RETURN(const ExportMap map, ExportMap::Open(scene, settings.exports.crs));
  std::map<SheetId, Eigen::AlignedBox3d> boxes;
  for (const SurveyCell& cell : survey.cells) {
    boxes[SheetOf({cell.x, cell.y})].extend(cell.box_min).extend(cell.box_max);
  }
  Faults faults;
  for (const auto& [id, box] : boxes) {
    faults.Add(map.BoxFromLocal(box, absl::StrCat("sheet ", SheetName(id))).status());
  }
  return faults.ToStatus();
}

}  // namespace tessera
