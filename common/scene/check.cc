#include "common/scene/check.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <numbers>
#include <unordered_map>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/parallel.h"
#include "common/geometry/repair.h"
#include "common/imaging/image_io.h"
#include "common/meshio/mesh_format.h"
#include "common/colmap/colmap.h"
#include "common/scene/coverage.h"
#include "common/scene/fit_findings.h"
#include "common/scene/repair_options.h"
#include "common/storage/hash.h"

namespace tessera {
namespace {

constexpr int64_t kMaxSampledFaces = 200000;

std::string CrsText(const Crs& crs) {
  constexpr double kDegreesPerRadian = 180 / std::numbers::pi;
  switch (crs.kind) {
    case Crs::Kind::kLocal:
      return "local";
    case Crs::Kind::kEnu:
      return absl::StrFormat("east-north-up at %.6f, %.6f, %.1f m (WGS 84)", crs.lat_rad * kDegreesPerRadian,
                             crs.lon_rad * kDegreesPerRadian, crs.height_m);
    case Crs::Kind::kUtm:
      return absl::StrCat("UTM zone ", crs.zone, crs.north ? " north" : " south", " (WGS 84)");
    case Crs::Kind::kEcef:
      return "earth-centred (WGS 84)";
  }
  return "";
}

double Median(std::vector<double>* values) {
  const auto middle = values->begin() + values->size() / 2;
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

class SceneChecker {
 public:
  SceneChecker(const SceneDescription& scene, int64_t max_mesh_faces, Warnings* warnings, Faults* faults,
               const TaskControl& control)
      : scene_(scene), max_mesh_faces_(max_mesh_faces), warnings_(*warnings), faults_(*faults), control_(control) {}

  StatusOr<SceneSummary> Check() {
    Describe();
    CheckPixels();
    TESSERA_RETURN_IF_ERROR(control_.Check());
    control_.Report(0.7, "mesh");
    TESSERA_RETURN_IF_ERROR(CheckMeshAndVisibility());
    control_.Report(0.95, "points");
    CheckReprojection();
    TESSERA_RETURN_IF_ERROR(control_.Check());
    control_.Report(1, "done");
    return summary_;
  }

 private:
  void Describe() {
    summary_.name = scene_.name;
    summary_.crs = CrsText(scene_.frame.crs());
    summary_.images = static_cast<int64_t>(scene_.views.size());
    summary_.has_likelihoods = scene_.has_likelihoods;
    std::map<std::pair<int, int>, int64_t> sizes;
    for (const Flight& flight : scene_.flights) summary_.flights.push_back({flight, 0});
    for (const SceneView& view : scene_.views) {
      ++sizes[{view.lens.pinhole.width, view.lens.pinhole.height}];
      if (view.flight >= 0 && view.flight < static_cast<int>(summary_.flights.size())) {
        ++summary_.flights[view.flight].images;
      }
    }
    for (const auto& [size, images] : sizes) summary_.sizes.push_back({size.first, size.second, images});
    for (const SceneClass& entry : scene_.classes) summary_.classes.push_back({entry.name, 0, 0});
  }

  // Decodes each image and each likelihood file once.
  void CheckPixels() {
    const int64_t views = summary_.images;
    const int classes = static_cast<int>(scene_.classes.size());
    std::vector<StatusOr<PixelContent>> contents(views, PixelContent());
    BorderCounts borders(classes);
    std::mutex borders_mutex;
    std::atomic<int64_t> done = 0;
    ParallelForEach(views, 1, [&](int64_t i) {
      if (!control_.Check().ok()) return;
      BorderCounts of_view(classes);
      contents[i] = ReadPixelContent(scene_.folder, scene_.views[i], classes, &of_view);
      {
        std::lock_guard lock(borders_mutex);
        borders.Add(of_view);
      }
      const int64_t now = ++done;
      control_.Report(0.7 * static_cast<double>(now) / static_cast<double>(views),
                      absl::StrCat("images, ", now, " of ", views));
    });
    for (const StatusOr<PixelContent>& content : contents) {
      faults_.Add(content.status());
      summary_.contents.push_back(content.ok() ? *content : PixelContent());
    }
    summary_.borders = borders.Trusts();
  }

  Status CheckMeshAndVisibility() {
    if (scene_.mesh_path.empty()) return absl::OkStatus();  // already reported
    const std::string path = absl::StrCat(scene_.folder, "/", scene_.mesh_path);
    const StatusOr<bool> is_larger = HasMoreFaces(path, max_mesh_faces_);
    if (!is_larger.ok()) {
      faults_.Add(is_larger.status());
      return absl::OkStatus();
    }
    if (*is_larger) return absl::OkStatus();
    StatusOr<TriangleMesh> loaded = LoadSceneMesh(scene_, 0, &warnings_);
    if (!loaded.ok()) {
      faults_.Add(loaded.status());
      return absl::OkStatus();
    }
    const TriangleMesh& mesh = *loaded;
    DescribeMesh(mesh);
    const StatusOr<RepairedMesh> repaired =
        RepairMesh(mesh, RepairOptionsOf(scene_.views, scene_.frame), &warnings_);
    if (!repaired.ok()) {
      faults_.Add(absl::InvalidArgumentError(absl::StrCat(path, ": ", std::string(repaired.status().message()))));
      return absl::OkStatus();
    }
    DescribeExtent(repaired->mesh);
    if (repaired->mesh.faces.empty()) {
      faults_.Add(InputError(path, "", "only degenerate faces", "at least one face with an area"));
      return absl::OkStatus();
    }
    if (scene_.views.empty()) return absl::OkStatus();
    const StatusOr<double> gsd_m = MedianGsd(scene_, repaired->mesh);
    if (gsd_m.ok()) {
      summary_.gsd_m = *gsd_m;
      faults_.Add(LoadSceneMesh(scene_, *gsd_m).status());  // checks the rounding of float coordinates
    }
    control_.Report(0.75, "visibility");
    TESSERA_ASSIGN_OR_RETURN(const Coverage coverage,
                             MeasureCoverage(scene_, repaired->mesh, kMaxSampledFaces, control_));
    TESSERA_RETURN_IF_ERROR(CheckFit(repaired->mesh));
    for (size_t i = 0; i < coverage.views.size(); ++i) {
      faults_.Add(ViewVisibilityError(path, scene_.views[i], coverage.views[i]));
    }
    summary_.faces_tried = coverage.faces_tried;
    summary_.unseen_share = static_cast<double>(coverage.unseen) / static_cast<double>(coverage.faces_tried);
    summary_.under_three_share = static_cast<double>(coverage.under_three) / static_cast<double>(coverage.faces_tried);
    return absl::OkStatus();
  }

  // Whether images, poses and mesh belong together; if not, what would make them.
  Status CheckFit(const TriangleMesh& mesh) {
    if (!faults_.messages().empty()) return absl::OkStatus();
    control_.Report(0.85, "fit of images and mesh");
    TaskControl silent = control_;
    silent.report = {};
    TESSERA_ASSIGN_OR_RETURN(SceneFit fit, MeasureFit(scene_, mesh, FitOptions(), silent));
    Reading reading;
    if (NeedsReading(fit, summary_.gsd_m)) {
      TESSERA_ASSIGN_OR_RETURN(reading, FindReading(scene_, mesh, fit, silent));
    }
    faults_.Add(JudgeFit(scene_, fit, reading, summary_.gsd_m, &warnings_));
    summary_.fit = std::move(fit);
    return absl::OkStatus();
  }

  void DescribeMesh(const TriangleMesh& mesh) {
    summary_.vertices = static_cast<int64_t>(mesh.vertices.size());
    summary_.faces = static_cast<int64_t>(mesh.faces.size());
    summary_.has_labels = !mesh.labels.empty();
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      const double area = FaceArea(mesh, f);
      summary_.surface_m2 += area;
      if (mesh.labels.empty()) continue;
      if (mesh.labels[f] < 0) {
        ++summary_.unlabelled_faces;
        continue;
      }
      SceneSummary::ClassShare& entry = summary_.classes[mesh.labels[f]];
      ++entry.faces;
      entry.area_share += area;
    }
    for (SceneSummary::ClassShare& entry : summary_.classes) {
      entry.area_share = summary_.surface_m2 > 0 ? entry.area_share / summary_.surface_m2 : 0;
    }
    if (summary_.unlabelled_faces > 0) {
      warnings_.push_back(absl::StrCat(scene_.mesh_path, ": ", summary_.unlabelled_faces, " faces have no label"));
    }
  }

  void DescribeExtent(const TriangleMesh& mesh) {
    const Eigen::Vector3d east = scene_.up_in_local.unitOrthogonal(), north = scene_.up_in_local.cross(east);
    const Eigen::Vector3d axes[3] = {std::abs(scene_.up_in_local.z()) > 0.999999 ? Eigen::Vector3d::UnitX() : east,
                                     std::abs(scene_.up_in_local.z()) > 0.999999 ? Eigen::Vector3d::UnitY() : north,
                                     scene_.up_in_local};
    Eigen::AlignedBox3d box;
    for (const Eigen::Vector3d& p : mesh.vertices) {
      box.extend(Eigen::Vector3d(axes[0].dot(p), axes[1].dot(p), axes[2].dot(p)));
    }
    summary_.extent_m2 = box.sizes().x() * box.sizes().y();
    const Eigen::Vector3d centre = box.center();
    const StatusOr<Eigen::Vector3d> geodetic =
        scene_.frame.GeodeticFromLocal(axes[0] * centre.x() + axes[1] * centre.y() + axes[2] * centre.z());
    if (geodetic.ok()) {
      summary_.lat_deg = geodetic->x() * 180 / std::numbers::pi;
      summary_.lon_deg = geodetic->y() * 180 / std::numbers::pi;
    }
  }

  // Measures the reprojection error of the model's image points, and the share of its 3D points that project into the
  // images of their tracks.
  void CheckReprojection() {
    if (scene_.views.empty()) return;
    const std::string folder = absl::StrCat(scene_.folder, "/", scene_.cameras_folder);
    Faults faults;
    const CalibratedImages model = ReadColmapModel(folder, CalibrationContent::kCamerasAndPoints, &faults);
    const std::vector<std::string> known = faults_.messages();
    for (const std::string& message : faults.messages()) {
      if (std::find(known.begin(), known.end(), message) == known.end()) {
        faults_.Add(absl::InvalidArgumentError(message));
      }
    }
    if (model.points.empty()) return;
    std::unordered_map<uint64_t, const TiePoint*> points;
    for (const TiePoint& point : model.points) points.emplace(point.id, &point);
    std::unordered_map<uint32_t, const CalibratedImage*> images;
    SceneSummary::Reprojection result;
    std::vector<double> errors_px;
    int64_t dangling = 0, inside = 0;
    const auto project = [&](const CalibratedImage& image, const Eigen::Vector3d& p) {
      const LensModel& lens = model.cameras.at(image.camera_id);
      const PosedCamera camera{lens.pinhole, image.rotation_cam_from_world, image.translation_cam_from_world};
      const Eigen::Vector3d q = camera.Project(p);
      const Eigen::Vector2d distorted = lens.Distort(q.head<2>());
      return Eigen::Vector3d(distorted.x(), distorted.y(), q.z());
    };
    for (const CalibratedImage& image : model.images) {
      images.emplace(image.id, &image);
      for (const ImageObservation& observation : image.observations) {
        const auto it = points.find(observation.point_id);
        if (it == points.end()) {
          ++dangling;
          continue;
        }
        const Eigen::Vector3d q = project(image, it->second->position);
        errors_px.push_back(q.z() > 0 ? (q.head<2>() - observation.position_px).norm() : 1e9);
      }
    }
    for (const TiePoint& point : model.points) {
      for (const uint32_t image_id : point.image_ids) {
        const auto it = images.find(image_id);
        if (it == images.end()) {
          ++dangling;
          continue;
        }
        ++result.track_entries;
        const PinholeCamera& camera = model.cameras.at(it->second->camera_id).pinhole;
        const Eigen::Vector3d q = project(*it->second, point.position);
        PosedCamera camera_alone;
        camera_alone.intrinsics = camera;
        inside += camera_alone.InImage(q);
      }
    }
    if (dangling > 0 && faults.empty()) {  // else they may refer to what could not be read
      warnings_.push_back(absl::StrCat(folder, ": ", dangling, " references to images or 3D points that do not exist"));
    }
    result.observations = static_cast<int64_t>(errors_px.size());
    if (!errors_px.empty()) result.median_px = Median(&errors_px);
    if (result.track_entries > 0) {
      result.inside_share = static_cast<double>(inside) / static_cast<double>(result.track_entries);
    }
    ReportReprojection(folder, result);
    summary_.reprojection = result;
  }

  void ReportReprojection(const std::string& folder, const SceneSummary::Reprojection& result) {
    constexpr double kWarning_px = 3, kError_px = 50, kWarningShare = 0.95, kErrorShare = 0.5;
    if (result.observations > 0 && result.median_px > kWarning_px) {
      const std::string found = absl::StrFormat("a median reprojection error of %.1f px", result.median_px);
      if (result.median_px > kError_px) {
        faults_.Add(InputError(folder, "", found,
                               absl::StrCat("cameras that fit their 3D points: at most ", kError_px, " px")));
      } else {
        warnings_.push_back(absl::StrCat(folder, ": ", found, ": check the camera poses"));
      }
    }
    if (result.track_entries > 0 && result.inside_share < kWarningShare) {
      const std::string found =
          absl::StrFormat("%.1f %% of the 3D points inside the images of their tracks", 100 * result.inside_share);
      if (result.inside_share < kErrorShare) {
        faults_.Add(InputError(folder, "", found,
                               absl::StrCat("cameras that fit their 3D points: at least ", 100 * kErrorShare, " %")));
      } else {
        warnings_.push_back(absl::StrCat(folder, ": ", found, ": check the camera poses"));
      }
    }
  }

  const SceneDescription& scene_;
  const int64_t max_mesh_faces_;
  Warnings& warnings_;
  Faults& faults_;
  const TaskControl& control_;
  SceneSummary summary_;
};

}  // namespace

StatusOr<PixelContent> ReadPixelContent(const std::string& folder, const SceneView& view, int classes,
                                        BorderCounts* borders) {
  PixelContent content;
  Faults faults;
  const auto take = [&faults](StatusOr<FloatImage> image, std::string* hash) -> FloatImage {
    faults.Add(image.status());
    if (!image.ok()) return {};
    *hash = Xxh3Hex(image->data.data(), image->data.size() * sizeof(float));
    return *std::move(image);
  };
  FloatImage luminance;
  if (!view.image_path.empty()) {
    luminance = take(ReadLuminance(absl::StrCat(folder, "/", view.image_path), view.lens), &content.image);
  }
  if (!view.likelihood_path.empty()) {
    if (borders == nullptr) luminance = FloatImage();  // release the image before the likelihoods are read
    const FloatImage likelihoods =
        take(ReadLikelihoods(absl::StrCat(folder, "/", view.likelihood_path), classes, view.lens), &content.likelihood);
    if (borders != nullptr) borders->Add(luminance, likelihoods);
  }
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return content;
}

Status ViewVisibilityError(const std::string& mesh_path, const SceneView& view, ViewVisibility visibility) {
  const std::string image = absl::StrCat("image '", view.name, "'");
  switch (visibility) {
    case ViewVisibility::kGood:
      return absl::OkStatus();
    case ViewVisibility::kNothing:
      return InputError(mesh_path, image, "no face in front of its camera and inside the image",
                        "a camera that sees the mesh: check its pose");
    case ViewVisibility::kBehindMesh:
      return InputError(mesh_path, image, "mostly backs of faces: its camera is behind the mesh",
                        "a camera that sees the front of the mesh: check its pose and the orientation of faces");
  }
  return absl::OkStatus();
}

StatusOr<SceneSummary> CheckSceneFolder(const std::string& path, Warnings* warnings, const TaskControl& control) {
  return CheckSceneFolder(path, SceneLoadOptions(), std::numeric_limits<int64_t>::max(), warnings, control);
}

StatusOr<SceneSummary> CheckSceneFolder(const std::string& path, const SceneLoadOptions& load, int64_t max_mesh_faces,
                                        Warnings* warnings, const TaskControl& control) {
  Faults faults;
  const SceneDescription scene = LoadSceneCollecting(path, load, warnings, &faults);
  if (scene.files.empty()) return faults.ToStatus();  // no scene.json
  Warnings unused;
  TESSERA_ASSIGN_OR_RETURN(
      SceneSummary summary,
      SceneChecker(scene, max_mesh_faces, warnings == nullptr ? &unused : warnings, &faults, control).Check());
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return summary;
}

}  // namespace tessera
