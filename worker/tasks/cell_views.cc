#include "worker/tasks/cell_views.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>

#include "common/base/parallel.h"
#include "common/geometry/ray_caster.h"

namespace tessera {
namespace {

constexpr double kOcclusionMarginGsd = 3;

Eigen::Vector3d Centroid(const TriangleMesh& mesh, size_t face) {
  return (mesh.Corner(face, 0) + mesh.Corner(face, 1) + mesh.Corner(face, 2)) / 3;
}

// 0: from above; 1 to 4: the quarter of the ground plane that the camera is in.
int DirectionOf(const Eigen::Vector3d& to_camera, const Survey& survey, double up_elevation_rad) {
  const Eigen::Vector3d d = to_camera.normalized();
  if (d.dot(survey.up) >= std::sin(up_elevation_rad)) return 0;
  const Eigen::Vector2d g = survey.ground.Coordinates(d);
  if (std::abs(g.x()) >= std::abs(g.y())) return g.x() >= 0 ? 1 : 2;
  return g.y() >= 0 ? 3 : 4;
}

std::vector<int32_t> BestViews(const TriangleMesh& mesh, const std::vector<uint32_t>& faces, const RayCaster& caster,
                               const std::vector<Eigen::Vector3d>& centres, const Survey& survey,
                               const CellViewOptions& options) {
  std::vector<std::vector<Sighting>> sightings;  // of each sample
  const size_t samples = std::min<size_t>(options.samples, faces.size());
  for (size_t i = 0; i < samples; ++i) {
    const size_t face = faces[i * faces.size() / samples];
    const Eigen::Vector3d centroid = Centroid(mesh, face), cross = FaceCross(mesh, face);
    const double area_m2 = 0.5 * cross.norm();
    if (area_m2 <= 0) continue;
    const Eigen::Vector3d normal = cross.normalized();
    std::vector<Sighting>& seen = sightings.emplace_back();
    for (size_t v = 0; v < survey.views.size(); ++v) {
      const PosedCamera& camera = survey.views[v].camera;
      const Eigen::Vector3d projected = camera.Project(centroid);
      if (!camera.InImage(projected)) continue;
      const Eigen::Vector3d to_camera = centres[v] - centroid;
      const double cosine = normal.dot(to_camera.normalized());
      if (cosine < options.min_cosine) continue;
      if (caster.Occluded(centroid, centres[v], kOcclusionMarginGsd * survey.gsd_m)) continue;
      const double px_per_m = std::sqrt(camera.intrinsics.fx * camera.intrinsics.fy) / projected.z();
      const double pixels = area_m2 * cosine * px_per_m * px_per_m;
      const int direction = DirectionOf(to_camera, survey, options.up_elevation_rad);
      seen.push_back({static_cast<int32_t>(v), direction, pixels, px_per_m});
    }
    WeighDetail(options.choice, &seen);
  }
  return ChooseBalanced(sightings, options.choice);
}

}  // namespace

Status FillCells(const TriangleMesh& mesh, const CellViewOptions& options, const TaskControl& control, Survey* survey) {
  const GroundPlane& ground = survey->ground;
  std::map<std::pair<int, int>, std::vector<uint32_t>> faces_of;  // by (y, x)
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Eigen::Vector2i cell = ground.Cell(Centroid(mesh, f));
    faces_of[{cell.y(), cell.x()}].push_back(static_cast<uint32_t>(f));
  }
  survey->cells.clear();
  std::vector<const std::vector<uint32_t>*> face_lists;
  for (const auto& [position, faces] : faces_of) {
    SurveyCell cell;
    cell.y = position.first;
    cell.x = position.second;
    cell.faces = static_cast<int64_t>(faces.size());
    cell.box_min = cell.box_max = mesh.Corner(faces[0], 0);
    const CellRect square = {cell.x, cell.y, cell.x + 1, cell.y + 1};
    for (const uint32_t face : faces) {
      for (int k = 0; k < 3; ++k) {
        const Eigen::Vector3d& p = mesh.Corner(face, k);
        cell.box_min = cell.box_min.cwiseMin(p);
        cell.box_max = cell.box_max.cwiseMax(p);
        cell.reach_m = std::max(cell.reach_m, DistanceToRect(ground.Coordinates(p), square, ground.cell_m));
      }
    }
    survey->cells.push_back(std::move(cell));
    face_lists.push_back(&faces);
  }

  const RayCaster caster(mesh);
  std::vector<Eigen::Vector3d> centres;
  for (const SceneView& view : survey->views) centres.push_back(view.camera.Centre());
  std::atomic<int64_t> done = 0;
  const int64_t count = static_cast<int64_t>(survey->cells.size());
  ParallelFor(count, 1, [&](int64_t begin, int64_t end) {
    for (int64_t c = begin; c < end; ++c) {
      if (!control.Check().ok()) return;
      survey->cells[c].views = BestViews(mesh, *face_lists[c], caster, centres, *survey, options);
      const int64_t cells_done = ++done;
      if (cells_done % 64 == 0) control.Report(static_cast<double>(cells_done) / count, "choosing views");
    }
  });
  return control.Check();
}

}  // namespace tessera
