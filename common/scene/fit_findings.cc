#include "common/scene/fit_findings.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera {
namespace {

// Poses of good aerial blocks are right to .1 to .2 px; errors above the first bound cost accuracy.
constexpr double kGoodPoses_px = 0.3;
constexpr double kGoodFocal = 0.003;  // relative
constexpr double kGoodMeshShift_gsd = 2;
constexpr int kJudgedPatches = 200;  // of a scene that is judged
constexpr size_t kListed = 20;

std::string Names(const SceneDescription& scene, const std::vector<int>& views) {
  std::string names;
  for (size_t i = 0; i < std::min(views.size(), kListed); ++i) {
    absl::StrAppend(&names, i > 0 ? ", " : "", scene.views[views[i]].name);
  }
  if (views.size() > kListed) absl::StrAppend(&names, " and ", views.size() - kListed, " more");
  return names;
}

bool IsShifted(const SceneFit& fit, double gsd_m) { return fit.mesh_shift_m.norm() > kGoodMeshShift_gsd * gsd_m; }

}  // namespace

bool NeedsReading(const SceneFit& fit, double gsd_m) {
  return fit.all.patches < kJudgedPatches || fit.all.above_chance < kBadFit || IsShifted(fit, gsd_m);
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
  if (fit.all.above_chance < kNoFit) {
    return InputError(path, "", absl::StrCat(found, " (5 % match by chance)"),
                      "cameras, images and mesh that fit: check the units, axes and offset of the mesh, and the poses");
  }
  const auto warn = [&](const std::string& text) { warnings->push_back(text); };
  // If little matches anywhere, differences between images say nothing about them.
  if (!fit.misplaced.empty() && 2 * fit.misplaced.size() < fit.views.size() && fit.all.above_chance >= kBadFit) {
    warn(absl::StrCat(fit.misplaced.size() == 1 ? "image" : "images", " that disagree with all others: ",
                      Names(scene, fit.misplaced), ": check their poses, or remove them"));
  } else if (fit.all.across_px > kGoodPoses_px) {
    warn(
        absl::StrFormat("%s: poses are wrong by %.2f px in the median (across the epipolar lines), expected at most "
                        "%.2f px: adjust the bundle again",
                        scene.cameras_folder, fit.all.across_px, kGoodPoses_px));
  }
  for (size_t c = 0; c < fit.cameras.size(); ++c) {
    if (std::abs(fit.focal_changes[c]) < kGoodFocal) continue;
    const PinholeCamera& camera = fit.cameras[c].pinhole;
    warn(absl::StrFormat(
        "%s: a camera of %d x %d has focal length %.1f px, but %.1f px would fit images and mesh "
        "better: check the intrinsics",
        scene.cameras_folder, camera.width, camera.height, camera.fx, camera.fx * (1 + fit.focal_changes[c])));
  }
  if (IsShifted(fit, gsd_m)) {
    const Eigen::Vector3d shift = scene.frame.rotation_local_from_scene().transpose() * fit.mesh_shift_m;
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

}  // namespace tessera
