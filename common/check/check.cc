#include "common/check/check.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <numbers>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/parallel.h"
#include "common/check/coverage.h"
#include "common/check/fit_findings.h"
#include "common/check/inspection.h"
#include "common/check/tie_points.h"
#include "common/colmap/colmap.h"
#include "common/geometry/repair.h"
#include "common/meshio/mesh_format.h"
#include "common/scene/repair_options.h"
#include "common/scene/skip_images.h"

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
    case Crs::Kind::kProjected:
      return crs.vertical_epsg == 0
                 ? absl::StrCat("map projection EPSG:", crs.epsg)
                 : absl::StrCat("map projection EPSG:", crs.epsg, ", heights EPSG:", crs.vertical_epsg);
  }
  return "";
}

class SceneChecker {
 public:
  SceneChecker(const SceneLoadOptions& load, int64_t max_mesh_faces, const InspectedFiles& files, Warnings* warnings,
               Faults* faults, const TaskControl& control, SceneDescription* scene)
      : load_(load),
        scene_(*scene),
        max_mesh_faces_(max_mesh_faces),
        files_(files),
        warnings_(*warnings),
        faults_(*faults),
        control_(control) {}

  StatusOr<SceneSummary> Check() {
    has_up_ = !WarnOfUp(scene_, &warnings_);
    TESSERA_RETURN_IF_ERROR(CheckPixels());
    Describe();
    if (WarnOfLikelihoodValues(scene_, digests_, &warnings_)) summary_.has_likelihoods = false;
    if (summary_.images == 1) {
      warnings_.push_back("1 image: only labels can be refined (--method labels); the mesh needs 2 images, better 3");
    } else if (summary_.images == 2) {
      warnings_.push_back("2 images: the mesh is refined only where both show it; 3 or more are better");
    }
    TESSERA_RETURN_IF_ERROR(control_.Check());
    control_.Report(0.7, "mesh");
    TESSERA_RETURN_IF_ERROR(CheckMeshAndVisibility());
    control_.Report(0.95, "points");
    CheckTiePoints();
    TESSERA_RETURN_IF_ERROR(control_.Check());
    if (summary_.fit) {
      summary_.fit_table = MakeFitTable(scene_, *summary_.fit, summary_.tie_points ? &*summary_.tie_points : nullptr);
    }
    control_.Report(1, "done");
    return summary_;
  }

 private:
  void Describe() {
    summary_.name = scene_.name;
    summary_.crs = CrsText(scene_.frame.crs());
    summary_.images = static_cast<int64_t>(scene_.views.size());
    summary_.skipped = scene_.skipped;
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

  // Decodes each image and each likelihood file that is not inspected, once. Removes the views of broken images that
  // may be skipped.
  Status CheckPixels() {
    const auto views = static_cast<int64_t>(scene_.views.size());
    const int classes = static_cast<int>(scene_.classes.size());
    std::vector<StatusOr<PixelContent>> contents(views, PixelContent());
    std::vector<Status> broken(views);
    BorderCounts borders(classes);
    std::mutex borders_mutex;
    std::atomic<int64_t> done = 0;
    digests_.resize(views);
    const auto compared = static_cast<int64_t>(ComparedStep(scene_.views.size()));
    std::vector<const ViewInspection*> known(views);
    std::vector<std::string> unknown;  // files
    for (int64_t i = 0; i < views; ++i) {
      const SceneView& view = scene_.views[i];
      known[i] = files_.inspections.Find(view, classes, i % compared == 0);
      if (known[i] == nullptr) unknown.insert(unknown.end(), {view.image_path, view.mask_path, view.likelihood_path});
    }
    TESSERA_RETURN_IF_ERROR(FetchInScene(scene_.folder, unknown, files_.fetch));
    ParallelForEach(views, 1, [&](int64_t i) {
      if (!control_.Check().ok()) return;
      ViewInspection found = known[i] ? *known[i] : InspectView(scene_.folder, scene_.views[i], classes);
      contents[i] = std::move(found.content);
      broken[i] = std::move(found.broken);
      if (i % compared != 0) found.digest.classes = LabelImage();
      digests_[i] = std::move(found.digest);
      if (digests_[i].is_read) {
        std::lock_guard lock(borders_mutex);
        borders.Add(found.borders);
      }
      const int64_t now = ++done;
      control_.Report(0.7 * static_cast<double>(now) / static_cast<double>(views),
                      absl::StrCat("images, ", now, " of ", views));
    });
    if (const Status skipped = SkipImages(broken, load_.skip_images, &warnings_, &scene_); skipped.ok()) {
      KeepUsable(broken, &contents);
      KeepUsable(broken, &digests_);
      broken.assign(contents.size(), absl::OkStatus());
    } else if (load_.skip_images > 0) {
      faults_.Add(skipped);
    }
    for (size_t i = 0; i < contents.size(); ++i) {
      const StatusOr<PixelContent>& content = contents[i];
      faults_.Add(broken[i]);
      faults_.Add(content.status());
      summary_.contents.push_back(content.ok() ? *content : PixelContent());
    }
    summary_.borders = borders.Trusts();
    WarnOfContents(scene_, summary_.contents, &warnings_);
    return absl::OkStatus();
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
    StatusOr<RepairedMesh> repaired = RepairMesh(mesh, RepairOptionsOf(scene_.views, scene_.frame), &warnings_);
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
    TESSERA_ASSIGN_OR_RETURN(const bool has_reading, CheckFit(repaired->mesh, AllViewsSee(coverage)));
    if (faults_.empty() && scene_.classes.size() > 1) {
      AddAvoidableFault(JudgeLabels(scene_, repaired->mesh, digests_, has_up_, &warnings_),
                        "likelihoods and labels do not agree", load_.anyway, &faults_, &warnings_);
    }
    if (!has_reading) AddVisibilityFaults(scene_, coverage, &faults_);  // else they follow from the reading
    summary_.faces_tried = coverage.faces_tried;
    summary_.unseen_share = static_cast<double>(coverage.unseen) / static_cast<double>(coverage.faces_tried);
    summary_.under_three_share = static_cast<double>(coverage.under_three) / static_cast<double>(coverage.faces_tried);
    mesh_ = std::move(repaired->mesh);
    return absl::OkStatus();
  }

  // Whether images, poses and mesh belong together; if not, what would make them. True if a reading explains it.
  StatusOr<bool> CheckFit(const TriangleMesh& mesh, bool all_views_see) {
    if (!faults_.messages().empty()) return false;
    control_.Report(0.85, "fit of images and mesh");
    TaskControl silent = control_;
    silent.report = {};
    TESSERA_ASSIGN_OR_RETURN(JudgedFit judged, tessera::CheckFit(scene_, mesh, summary_.gsd_m, all_views_see, silent,
                                                                 &warnings_, files_.fetch));
    AddFitFault(judged, load_.anyway, &faults_, &warnings_);
    summary_.fit = std::move(judged.fit);
    return judged.has_reading;
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

  // Compares the model's 3D points with its images and with the mesh.
  void CheckTiePoints() {
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
    TiePointFigures figures = MeasureTiePoints(model);
    if (!mesh_.faces.empty()) MeasurePointDistances(model, scene_, mesh_, &figures);
    const bool fits = summary_.fit && summary_.fit->all.above_chance >= kBadFit;
    // References to what could not be read may be missing.
    JudgeTiePoints(scene_, figures, {fits, faults.empty(), summary_.gsd_m}, &faults_, &warnings_);
    summary_.tie_points = std::move(figures);
  }

  const SceneLoadOptions& load_;
  SceneDescription& scene_;
  const int64_t max_mesh_faces_;
  const InspectedFiles& files_;
  Warnings& warnings_;
  Faults& faults_;
  const TaskControl& control_;
  SceneSummary summary_;
  TriangleMesh mesh_;                      // repaired; empty if it cannot be read or is streamed
  std::vector<LikelihoodDigest> digests_;  // of each view
  bool has_up_ = false;                    // the up direction is not doubtful
};

}  // namespace

StatusOr<CheckedScene> CheckScene(const std::string& path, const SceneLoadOptions& load, int64_t max_mesh_faces,
                                  Warnings* warnings, const TaskControl& control, const InspectedFiles& files) {
  Warnings unused;
  if (warnings == nullptr) warnings = &unused;
  Faults faults;
  CheckedScene checked;
  SceneLoadOptions with_files = load;
  files.inspections.AddTo(&with_files);
  checked.scene = LoadSceneCollecting(path, with_files, warnings, &faults);
  if (checked.scene.files.empty()) return faults.ToStatus();  // no scene.json
  TESSERA_RETURN_IF_ERROR(CompletePixelForms(std::vector<uint8_t>(checked.scene.views.size(), 1), {}, files, control,
                                             &checked.scene, warnings));
  TESSERA_ASSIGN_OR_RETURN(
      checked.summary, SceneChecker(load, max_mesh_faces, files, warnings, &faults, control, &checked.scene).Check());
  faults.Add(SkipAdvice(checked.scene));
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return checked;
}

StatusOr<SceneSummary> CheckSceneFolder(const std::string& path, Warnings* warnings, const TaskControl& control) {
  TESSERA_ASSIGN_OR_RETURN(CheckedScene checked, CheckScene(path, SceneLoadOptions(),
                                                            std::numeric_limits<int64_t>::max(), warnings, control));
  return std::move(checked.summary);
}

}  // namespace tessera
