#include "common/exporting/folder/result_folder.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "common/base/json_bounds.h"
#include "common/job/task_parameters.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

using ResultJson = nlohmann::json;

StatusOr<ResultJson> ReadResultJson(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const std::string text, ReadFile(path));
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(path, text));
  ResultJson json = ResultJson::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) return InputError(path, "", "no JSON object", "the file that a job wrote");
  return json;
}

// The facts of report.json that exports use.
struct ReportFacts {
  std::optional<ExportScene> scene;
  ViewNamesOfSheets views_of_sheets;
  std::vector<std::string> class_names;
  double gsd_m = 0;
  int failed_tiles = 0;
};

StatusOr<ReportFacts> ReadReport(const std::string& path) {
  ReportFacts facts;
  if (!FileExists(path)) return facts;
  TESSERA_ASSIGN_OR_RETURN(const ResultJson report, ReadResultJson(path));
  try {
    if (report.contains("frame")) {
      TESSERA_ASSIGN_OR_RETURN(facts.scene, ParseExportScene(report.at("frame").dump()));
    }
    if (report.contains("views_of_sheets")) {
      TESSERA_ASSIGN_OR_RETURN(facts.views_of_sheets, ParseViewNames(report.at("views_of_sheets").dump()));
    }
    facts.class_names = report.value("classes", std::vector<std::string>());
    facts.gsd_m = report.value("gsd_m", 0.0);
    for (const ResultJson& tile : report.value("tiles", ResultJson::array())) {
      facts.failed_tiles += tile.value("quarantined", false);
    }
  } catch (const ResultJson::exception& error) {
    return InputError(path, "", error.what(), "the report of a job");
  }
  return facts;
}

StatusOr<std::vector<CellRect>> ReadFailedCores(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const ResultJson index, ReadResultJson(path));
  std::vector<CellRect> cores;
  try {
    for (const ResultJson& tile : index.at("tiles")) {
      if (!tile.value("quarantined", false)) continue;
      const ResultJson& core = tile.at("core_cells");
      cores.push_back({core.at(0), core.at(1), core.at(2), core.at(3)});
    }
  } catch (const ResultJson::exception& error) {
    return InputError(path, "", error.what(), "the index of a result's tiles");
  }
  return cores;
}

StatusOr<SceneDescription> LoadSceneOfResult(const std::string& scene_path, const ReportFacts& facts,
                                             bool needs_photographs) {
  SceneLoadOptions options;
  options.needs_mesh = false;
  options.all_classes = facts.class_names != std::vector<std::string>{OneClass().name};
  options.to_be_classified = options.all_classes;  // likelihoods are not read
  if (facts.scene) options.frame = facts.scene->frame;
  Warnings known;  // the job has given them
  Faults faults;
  SceneDescription scene = LoadSceneCollecting(scene_path, options, &known, &faults);
  // Images may be missing if no photograph is read.
  if (needs_photographs || scene.unusable_images == 0) TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  const std::vector<std::string> names = ClassNames(scene);
  if (!facts.class_names.empty() && names != facts.class_names) {
    return InputError(scene_path, "classes", absl::StrJoin(names, ", "),
                      absl::StrCat("those of the result (", absl::StrJoin(facts.class_names, ", "),
                                   "): give the scene that the result was made of"));
  }
  return scene;
}

StatusOr<ExportScene> ExportSceneOfFolder(const SceneDescription& described, double gsd_m) {
  ExportScene scene;
  scene.frame = described.frame;
  scene.up = described.up_in_local;
  scene.classes = described.classes;
  scene.source = described.source;
  scene.gsd_m = gsd_m;
  if (!(gsd_m > 0)) {
    TESSERA_ASSIGN_OR_RETURN(const TriangleMesh mesh, LoadSceneMesh(described, 0));
    TESSERA_ASSIGN_OR_RETURN(scene.gsd_m, MedianGsd(described, mesh));
  }
  scene.ground = MakeGroundPlane(scene.up, CellSide_m(scene.gsd_m));
  return scene;
}

bool Overlap(const CellRect& a, const CellRect& b) { return a.x0 < b.x1 && b.x0 < a.x1 && a.y0 < b.y1 && b.y0 < a.y1; }

}  // namespace

StatusOr<ResultFolder> OpenResultFolder(const std::string& path, const std::string& scene_path,
                                        bool needs_photographs) {
  ResultFolder result;
  result.mesh_path = absl::StrCat(path, "/", kMeshFile);
  const std::string report_path = absl::StrCat(path, "/", kReportFile);
  if (!FileExists(result.mesh_path)) {
    return InputError(path, "", absl::StrCat("no file ", kMeshFile),
                      "the folder of a result: OUT of `tessera run` or `tessera fetch`");
  }
  TESSERA_ASSIGN_OR_RETURN(ReportFacts facts, ReadReport(report_path));
  result.views_of_sheets = std::move(facts.views_of_sheets);
  if (!scene_path.empty()) {
    TESSERA_ASSIGN_OR_RETURN(result.described, LoadSceneOfResult(scene_path, facts, needs_photographs));
  }
  if (facts.scene) {
    result.scene = *facts.scene;
  } else if (result.described) {
    TESSERA_ASSIGN_OR_RETURN(result.scene, ExportSceneOfFolder(*result.described, facts.gsd_m));
  } else {
    return InputError(report_path, "frame",
                      FileExists(report_path) ? "no such member: the result is of an earlier version" : "no such file",
                      "--scene SCENE, the folder of the scene that the result was made of");
  }
  const std::string index_path = absl::StrCat(path, "/", kTileIndexFile);
  if (FileExists(index_path)) {
    TESSERA_ASSIGN_OR_RETURN(result.set_aside_cores, ReadFailedCores(index_path));
  } else {
    result.is_set_aside = facts.failed_tiles > 0;
  }
  const std::string changes_path = absl::StrCat(path, "/changes.geojson");
  if (FileExists(changes_path)) result.changes_path = changes_path;
  return result;
}

bool IsSetAside(const ResultFolder& result, const SheetId& sheet) {
  const CellRect cells = CellsOf(sheet);
  return result.is_set_aside || std::any_of(result.set_aside_cores.begin(), result.set_aside_cores.end(),
                                            [&](const CellRect& core) { return Overlap(core, cells); });
}

}  // namespace tessera
