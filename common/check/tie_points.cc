#include "common/check/tie_points.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/parallel.h"
#include "common/colmap/calibrated_images.h"
#include "common/geometry/nearest_surface.h"
#include "common/scene/image_files.h"

namespace tessera {
namespace {

constexpr size_t kLeastImagePoints = 10;  // of an image with a median of its own
constexpr size_t kPointsFromMesh = 4000;  // whose distance from the mesh is measured
constexpr double kStale_px = 4, kStaleRatio = 4;
constexpr double kFarFromBadMesh_gsd = 2, kFarFromMesh_gsd = 10;
constexpr size_t kListedImages = 20;

double TakeMedian(std::vector<double>* values) {
  const auto middle = values->begin() + static_cast<ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

// Fewer than half of the images: else the model as a whole is wrong.
void FindStaleImages(TiePointFigures* figures) {
  if (figures->images_px.size() < 3) return;
  std::vector<double> medians;
  for (const auto& [name, median_px] : figures->images_px) medians.push_back(median_px);
  const double far_px = std::max(kStale_px, kStaleRatio * TakeMedian(&medians));
  for (const auto& [name, median_px] : figures->images_px) {
    if (median_px > far_px) figures->stale.push_back(name);
  }
}

}  // namespace

TiePointFigures MeasureTiePoints(const CalibratedImages& model) {
  std::unordered_map<uint64_t, const TiePoint*> points;
  for (const TiePoint& point : model.points) points.emplace(point.id, &point);
  std::unordered_map<uint32_t, const CalibratedImage*> images;
  TiePointFigures figures;
  std::vector<double> errors_px;
  int64_t inside = 0;
  const auto project = [&](const CalibratedImage& image, const Eigen::Vector3d& p) {
    const LensModel& lens = model.cameras.at(image.camera_id);
    const PosedCamera camera{lens.pinhole, image.rotation_cam_from_world, image.translation_cam_from_world};
    const Eigen::Vector3d q = camera.Project(p);
    const Eigen::Vector2d distorted = lens.Distort(q.head<2>());
    return Eigen::Vector3d(distorted.x(), distorted.y(), q.z());
  };
  for (const CalibratedImage& image : model.images) {
    images.emplace(image.id, &image);
    std::vector<double> of_image_px;
    for (const ImageObservation& observation : image.observations) {
      const auto it = points.find(observation.point_id);
      if (it == points.end()) {
        ++figures.dangling;
        continue;
      }
      const Eigen::Vector3d q = project(image, it->second->position);
      const double error_px = (q.head<2>() - observation.position_px).norm();
      of_image_px.push_back(q.z() > 0 && std::isfinite(error_px) ? error_px : std::numeric_limits<double>::infinity());
    }
    errors_px.insert(errors_px.end(), of_image_px.begin(), of_image_px.end());
    if (of_image_px.size() >= kLeastImagePoints) {
      figures.images_px[PlainImageName(image.name)] = TakeMedian(&of_image_px);
    }
  }
  for (const TiePoint& point : model.points) {
    for (const uint32_t image_id : point.image_ids) {
      const auto it = images.find(image_id);
      if (it == images.end()) {
        ++figures.dangling;
        continue;
      }
      ++figures.track_entries;
      PosedCamera camera_alone;
      camera_alone.intrinsics = model.cameras.at(it->second->camera_id).pinhole;
      inside += camera_alone.InImage(project(*it->second, point.position));
    }
  }
  figures.observations = static_cast<int64_t>(errors_px.size());
  if (!errors_px.empty()) figures.median_px = TakeMedian(&errors_px);
  if (figures.track_entries > 0) {
    figures.inside_share = static_cast<double>(inside) / static_cast<double>(figures.track_entries);
  }
  FindStaleImages(&figures);
  return figures;
}

void MeasurePointDistances(const CalibratedImages& model, const SceneDescription& scene, const TriangleMesh& mesh,
                           TiePointFigures* figures) {
  const size_t step = std::max<size_t>(1, model.points.size() / kPointsFromMesh), count = model.points.size() / step;
  if (count == 0) return;
  const NearestSurface surface(mesh);
  std::vector<double> signed_m(count), lengths_m(count);
  ParallelForEach(count, 64, [&](size_t i) {
    const Eigen::Vector3d p = scene.frame.LocalFromScene(model.points[i * step].position);
    const NearestPoint nearest = surface.Find(p);
    const bool outside = FaceCross(mesh, static_cast<size_t>(nearest.face)).dot(p - nearest.point) >= 0;
    lengths_m[i] = nearest.distance_m;
    signed_m[i] = outside ? nearest.distance_m : -nearest.distance_m;
  });
  figures->above_mesh_m = TakeMedian(&signed_m);
  figures->from_mesh_m = TakeMedian(&lengths_m);
}

void JudgeTiePoints(const SceneDescription& scene, const TiePointFigures& figures, const TiePointContext& context,
                    Faults* faults, Warnings* warnings) {
  constexpr double kWarning_px = 3, kError_px = 50, kWarningShare = 0.95, kErrorShare = 0.5;
  const std::string folder = absl::StrCat(scene.folder, "/", scene.cameras_folder);
  if (figures.dangling > 0 && context.is_complete) {
    warnings->push_back(
        absl::StrCat(folder, ": ", figures.dangling, " references to images or 3D points that do not exist"));
  }
  if (figures.observations > 0 && figures.median_px > kWarning_px) {
    const std::string found = absl::StrFormat("a median reprojection error of %.1f px", figures.median_px);
    if (figures.median_px > kError_px) {
      faults->Add(
          InputError(folder, "", found, absl::StrCat("cameras that fit their 3D points: at most ", kError_px, " px")));
    } else {
      warnings->push_back(absl::StrCat(folder, ": ", found, ": check the camera poses"));
    }
  }
  if (figures.track_entries > 0 && figures.inside_share < kWarningShare) {
    const std::string found =
        absl::StrFormat("%.1f %% of the 3D points inside the images of their tracks", 100 * figures.inside_share);
    if (figures.inside_share < kErrorShare) {
      faults->Add(InputError(folder, "", found,
                             absl::StrCat("cameras that fit their 3D points: at least ", 100 * kErrorShare, " %")));
    } else {
      warnings->push_back(absl::StrCat(folder, ": ", found, ": check the camera poses"));
    }
  }
  if (!figures.stale.empty()) {
    std::string names;
    for (size_t i = 0; i < std::min(figures.stale.size(), kListedImages); ++i) {
      const double error_px = figures.images_px.at(figures.stale[i]);
      absl::StrAppend(&names, i > 0 ? ", " : "", figures.stale[i], " (",
                      std::isfinite(error_px) ? absl::StrFormat("%.1f px", error_px) : "behind it", ")");
    }
    if (figures.stale.size() > kListedImages) {
      absl::StrAppend(&names, " and ", figures.stale.size() - kListedImages, " more");
    }
    warnings->push_back(absl::StrCat(folder, ": the poses of ", figures.stale.size(), " of ", figures.images_px.size(),
                                     " images do not fit their 3D points (median reprojection error): ", names,
                                     ": take poses and points from one adjustment"));
  }
  if (!figures.from_mesh_m || !(context.gsd_m > 0)) return;
  const double above_m = *figures.above_mesh_m, from_m = *figures.from_mesh_m;
  if (from_m > kFarFromMesh_gsd * context.gsd_m ||
      (!context.mesh_fits && std::abs(above_m) > kFarFromBadMesh_gsd * context.gsd_m)) {
    warnings->push_back(absl::StrFormat(
        "%s: the 3D points of the cameras are %.2f m from the mesh in the median (%.2f m outside it, with sign), "
        "expected at most %.2f m: check the offset and the unit of the mesh",
        scene.mesh_path, from_m, above_m, kFarFromBadMesh_gsd * context.gsd_m));
  }
}

}  // namespace tessera
