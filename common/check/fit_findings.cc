#include "common/check/fit_findings.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera {
namespace {

// Poses of good aerial blocks are right to .1 to .2 px; errors above the first bound cost accuracy.
constexpr double kGoodPoses_px = 0.3;
constexpr double kGoodFocal = 0.003;  // relative
constexpr double kGoodMeshShift_gsd = 2;
constexpr double kSuspectedSideways = 4;  // standard deviations: FindReading looks closer
constexpr size_t kListed = 20;

std::string Names(const SceneDescription& scene, const std::vector<int>& views) {
  std::string names;
  for (size_t i = 0; i < std::min(views.size(), kListed); ++i) {
    absl::StrAppend(&names, i > 0 ? ", " : "", scene.views[views[i]].name);
  }
  if (views.size() > kListed) absl::StrAppend(&names, " and ", views.size() - kListed, " more");
  return names;
}

bool IsShift(const Eigen::Vector3d& shift_m, double gsd_m) { return shift_m.norm() > kGoodMeshShift_gsd * gsd_m; }

std::string CameraText(const LensModel& lens) {
  return absl::StrFormat("%d x %d, focal length %.1f px", lens.pinhole.width, lens.pinhole.height, lens.pinhole.fx);
}

// Cameras whose measured images all disagree with those of others: their intrinsics are wrong rather than each pose.
std::vector<int> MisplacedCameras(const SceneFit& fit) {
  std::vector<int> found;
  for (size_t c = 0; c < fit.cameras.size() && fit.cameras.size() > 1; ++c) {
    int measured = 0, misplaced = 0;
    for (size_t v = 0; v < fit.views.size(); ++v) {
      if (fit.camera_of[v] != static_cast<int>(c) || fit.views[v].patches == 0) continue;
      ++measured;
      misplaced += std::binary_search(fit.misplaced.begin(), fit.misplaced.end(), static_cast<int>(v));
    }
    if (measured > 1 && misplaced == measured) found.push_back(static_cast<int>(c));
  }
  return found;
}

nlohmann::ordered_json ShareToJson(const FitShare& share) {
  nlohmann::ordered_json json = {{"pairs", share.pairs}, {"patches", share.patches}};
  if (share.patches > 0) json["above_chance"] = share.above_chance;
  if (share.across_px >= 0) json["across_px"] = share.across_px, json["along_px"] = share.along_px;
  return json;
}

}  // namespace

ReadingSearch SearchFor(const SceneFit& fit, double gsd_m, bool all_views_see) {
  ReadingSearch search;
  search.all = fit.all.patches < kJudgedPatches || fit.all.above_chance < kBadFit || !all_views_see;
  search.shift = IsShift(fit.mesh_shift_m, gsd_m) || fit.sideways_deviations > kSuspectedSideways;
  return search;
}

Status JudgeFit(const SceneDescription& scene, const SceneFit& fit, const Reading& reading, double gsd_m,
                Warnings* warnings) {
  const std::string path = absl::StrCat(scene.folder, "/", scene.mesh_path);
  const std::string found = absl::StrFormat("images that match through the mesh at %.0f %% of %d patches",
                                            100 * fit.all.above_chance, fit.all.patches);
  if (!reading.fault.empty()) {
    return InputError(path, "", found,
                      absl::StrFormat("cameras, images and mesh that fit. %.0f %% would match if %s",
                                      100 * reading.above_chance, reading.fault));
  }
  if (fit.all.patches < kJudgedPatches) return absl::OkStatus();
  if (fit.all.above_chance < fit.least_above_chance) {
    return InputError(path, "", absl::StrCat(found, " (5 % match by chance)"),
                      "cameras, images and mesh that fit: check the units, axes and offset of the mesh, and the poses");
  }
  const auto warn = [&](const std::string& text) { warnings->push_back(text); };
  // If little matches anywhere, differences between images say nothing about them.
  if (!fit.misplaced.empty() && 2 * fit.misplaced.size() < fit.views.size() && fit.all.above_chance >= kBadFit) {
    warn(absl::StrCat(fit.misplaced.size() == 1 ? "image that disagrees" : "images that disagree",
                      " with all others: ", Names(scene, fit.misplaced), ": check their poses, or remove them"));
  }
  if (fit.pose_error_px > kGoodPoses_px) {
    warn(
        absl::StrFormat("%s: poses are wrong by about %.2f px (across the epipolar lines), expected at most %.2f px: "
                        "adjust the bundle again",
                        scene.cameras_folder, fit.pose_error_px, kGoodPoses_px));
  }
  for (const int camera : MisplacedCameras(fit)) {
    warn(
        absl::StrFormat("%s: all images of the camera of %s disagree with those of other cameras: check its intrinsics",
                        scene.cameras_folder, CameraText(fit.cameras[camera])));
  }
  for (size_t c = 0; c < fit.cameras.size(); ++c) {
    if (std::abs(fit.focal_changes[c]) < kGoodFocal) continue;
    const PinholeCamera& camera = fit.cameras[c].pinhole;
    warn(absl::StrFormat(
        "%s: a camera of %d x %d has focal length %.1f px, but %.1f px would fit images and mesh "
        "better: check the intrinsics",
        scene.cameras_folder, camera.width, camera.height, camera.fx, camera.fx * (1 + fit.focal_changes[c])));
  }
  // Shifts that more patches match by are surer than those that small offsets show.
  const Eigen::Vector3d shift_m = reading.mesh_shift_m.isZero() ? fit.mesh_shift_m : reading.mesh_shift_m;
  if (IsShift(shift_m, gsd_m)) {
    const Eigen::Vector3d shift = scene.frame.rotation_local_from_scene().transpose() * shift_m;
    warn(
        absl::StrFormat("%s: the mesh would fit the images better if it were moved by (%.2f, %.2f, %.2f) m: check its "
                        "offset and vertical datum",
                        scene.mesh_path, shift.x(), shift.y(), shift.z()));
  } else if (fit.all.above_chance < kBadFit) {
    warn(absl::StrCat(scene.mesh_path, ": found ", found, ", expected at least ", 100 * kBadFit,
                      " %: the mesh is far from the surface that the images show"));
  }
  return absl::OkStatus();
}

std::string FitText(const SceneFit& fit) {
  if (fit.all.patches == 0) return "not measured: no two images see the same surface";
  return absl::StrFormat("%.0f %% of %d patches match; offsets %.2f px across and %.2f px along the epipolar lines",
                         100 * fit.all.above_chance, fit.all.patches, fit.all.across_px, fit.all.along_px);
}

StatusOr<JudgedFit> CheckFit(const SceneDescription& scene, const FitSurface& surface, double gsd_m, bool all_views_see,
                             const TaskControl& control, Warnings* warnings, const FetchFiles& fetch) {
  JudgedFit judged;
  TESSERA_ASSIGN_OR_RETURN(judged.fit, MeasureFit(scene, surface, FitOptions(), control, fetch));
  TESSERA_ASSIGN_OR_RETURN(
      const Reading reading,
      FindReading(scene, surface, judged.fit, gsd_m, SearchFor(judged.fit, gsd_m, all_views_see), control, fetch));
  judged.fault = JudgeFit(scene, judged.fit, reading, gsd_m, warnings);
  judged.has_reading = !reading.fault.empty();
  return judged;
}

void AddAvoidableFault(const Status& fault, const char* although, bool anyway, Faults* faults, Warnings* warnings) {
  if (fault.ok()) return;
  if (anyway) {
    warnings->emplace_back(fault.message());
    return;
  }
  faults->Add(fault);
  faults->Add(absl::InvalidArgumentError(absl::StrCat("to go on although ", although, ": --anyway")));
}

void AddFitFault(const JudgedFit& judged, bool anyway, Faults* faults, Warnings* warnings) {
  AddAvoidableFault(judged.fault, "images, poses and mesh do not fit", anyway, faults, warnings);
}

FitTable MakeFitTable(const SceneDescription& scene, const SceneFit& fit, const TiePointFigures* tie_points) {
  FitTable table;
  table.all = fit.all;
  const std::vector<int> misplaced_cameras = MisplacedCameras(fit);
  for (size_t c = 0; c < fit.cameras.size(); ++c) {
    const bool disagrees = std::binary_search(misplaced_cameras.begin(), misplaced_cameras.end(), static_cast<int>(c));
    table.cameras.push_back({CameraText(fit.cameras[c]), fit.camera_shares[c], -1, disagrees});
  }
  for (size_t v = 0; v < scene.views.size(); ++v) {
    FitTable::Row row{scene.views[v].name, fit.views[v], -1, false};
    row.disagrees = std::binary_search(fit.misplaced.begin(), fit.misplaced.end(), static_cast<int>(v));
    if (tie_points != nullptr) {
      const auto found = tie_points->images_px.find(row.name);
      if (found != tie_points->images_px.end()) row.reprojection_px = std::min(found->second, 1e9);
      const auto& stale = tie_points->stale;
      row.disagrees |= std::find(stale.begin(), stale.end(), row.name) != stale.end();
    }
    if (row.share.patches > 0 || row.reprojection_px >= 0) table.images.push_back(std::move(row));
  }
  std::stable_sort(table.images.begin(), table.images.end(), [](const FitTable::Row& a, const FitTable::Row& b) {
    const auto rank = [](const FitTable::Row& row) {
      return std::make_tuple(!row.disagrees, row.share.patches == 0, row.share.above_chance);
    };
    return rank(a) < rank(b);
  });
  return table;
}

std::string FitTableToText(const FitTable& table, size_t most_rows) {
  std::string text;
  const auto add = [&](const char* what, const std::vector<FitTable::Row>& rows) {
    if (rows.empty()) return;
    const size_t shown = std::min(rows.size(), most_rows);
    absl::StrAppend(
        &text, absl::StrFormat("%-40s %6s %7s %9s %8s %12s\n",
                               rows.size() > shown ? absl::StrCat(what, " (", shown, " of ", rows.size(), ")") : what,
                               "pairs", "match", "across", "along", "reprojection"));
    const auto px = [](double value) { return value < 0 ? "-" : absl::StrFormat("%.2f px", value); };
    for (size_t i = 0; i < shown; ++i) {
      const FitTable::Row& row = rows[i];
      absl::StrAppend(
          &text, absl::StrFormat("  %-38s %6d %7s %9s %8s %12s%s\n", row.name, row.share.pairs,
                                 row.share.patches > 0 ? absl::StrFormat("%.0f %%", 100 * row.share.above_chance) : "-",
                                 px(row.share.across_px), px(row.share.along_px), px(row.reprojection_px),
                                 row.disagrees ? "  disagrees" : ""));
    }
  };
  add("fit by camera", table.cameras);
  add("fit by image, the worst first", table.images);
  return text;
}

std::string FitTableToJson(const FitTable& table, size_t most_images) {
  nlohmann::ordered_json json = ShareToJson(table.all);
  const auto add = [&json](const char* key, const std::vector<FitTable::Row>& rows, size_t most) {
    json[key] = nlohmann::ordered_json::array();
    for (size_t i = 0; i < std::min(rows.size(), most); ++i) {
      nlohmann::ordered_json row = {{"name", rows[i].name}};
      row.update(ShareToJson(rows[i].share));
      if (rows[i].reprojection_px >= 0) row["reprojection_px"] = rows[i].reprojection_px;
      if (rows[i].disagrees) row["disagrees"] = true;
      json[key].push_back(std::move(row));
    }
  };
  add("cameras", table.cameras, table.cameras.size());
  add("images", table.images, most_images);
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace tessera
