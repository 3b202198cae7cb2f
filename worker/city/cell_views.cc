#include "worker/city/cell_views.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/base/parallel.h"
#include "worker/city/view_box.h"

namespace tessera {
namespace {

constexpr int64_t kCoarseClusters = 1 << 20;

// 0: from above; 1 to 4: the quadrant of the ground plane that contains the camera.
int DirectionOf(const Eigen::Vector3d& to_camera, const Survey& survey, double up_elevation_rad) {
  const Eigen::Vector3d d = to_camera.normalized();
  if (d.dot(survey.up) >= std::sin(up_elevation_rad)) return 0;
  const Eigen::Vector2d g = survey.ground.Coordinates(d);
  if (std::abs(g.x()) >= std::abs(g.y())) return g.x() >= 0 ? 1 : 2;
  return g.y() >= 0 ? 3 : 4;
}

// Keeps only observations of the newest epoch if they cover enough of the samples.
void PreferNewest(const CellViewOptions& options, std::vector<std::vector<SampleObservation>>* samples) {
  const std::vector<int>& epochs = options.epoch_of_view;
  if (epochs.empty()) return;
  int newest = std::numeric_limits<int>::min();
  for (const auto& observations : *samples) {
    for (const SampleObservation& seen : observations) newest = std::max(newest, epochs[seen.view]);
  }
  const auto is_new = [&](const SampleObservation& seen) { return epochs[seen.view] == newest; };
  int64_t by_all = 0, by_new = 0;
  for (const auto& observations : *samples) {
    by_all += observations.size() >= 2;
    by_new += std::count_if(observations.begin(), observations.end(), is_new) >= 2;
  }
  if (by_new == 0 || static_cast<double>(by_new) < options.enough * static_cast<double>(by_all)) return;
  for (auto& observations : *samples)
    std::erase_if(observations, [&](const SampleObservation& seen) { return !is_new(seen); });
}

}  // namespace

std::vector<int32_t> ChooseViewsOfCell(const MeshSpans& mesh, const std::vector<uint32_t>& faces,
                                       const OcclusionTest& occlusion, const std::vector<Eigen::Vector3d>& centres,
                                       const std::vector<size_t>& candidates, const Survey& survey,
                                       const CellViewOptions& options) {
  std::vector<std::vector<SampleObservation>> observations;  // per sample
  const size_t samples = std::min<size_t>(options.samples, faces.size());
  for (size_t i = 0; i < samples; ++i) {
    const size_t face = faces[i * faces.size() / samples];
    const Eigen::Vector3d centroid = mesh.Centroid(face), cross = FaceCross(mesh, face);
    const double area_m2 = 0.5 * cross.norm();
    if (area_m2 <= 0) continue;
    const Eigen::Vector3d normal = cross.normalized();
    std::vector<SampleObservation>& seen = observations.emplace_back();
    for (const size_t v : candidates) {
      const PosedCamera& camera = survey.views[v].camera;
      const Eigen::Vector3d projected = camera.Project(centroid);
      if (!camera.InImage(projected)) continue;
      const Eigen::Vector3d to_camera = centres[v] - centroid;
      const double cosine = normal.dot(to_camera.normalized());
      if (cosine < options.min_cosine) continue;
      if (occlusion.Hidden(centroid, centres[v])) continue;
      const double px_per_m = std::sqrt(camera.intrinsics.fx * camera.intrinsics.fy) / projected.z();
      const double pixels = area_m2 * cosine * px_per_m * px_per_m;
      const int direction = DirectionOf(to_camera, survey, options.up_elevation_rad);
      seen.push_back({static_cast<int32_t>(v), direction, pixels, px_per_m});
    }
  }
  PreferNewest(options, &observations);
  for (std::vector<SampleObservation>& seen : observations) WeighByResolution(options.choice, &seen);
  return ChooseBalanced(observations, options.choice);
}

std::map<std::pair<int, int>, std::vector<uint32_t>> FacesOfCells(const CityBlock& block, const GroundPlane& ground) {
  std::map<std::pair<int, int>, std::vector<uint32_t>> faces_of;
  for (size_t f = 0; f < block.face_ids.size(); ++f) {
    const Eigen::Vector2i at = ground.Cell(block.mesh.Centroid(f));
    faces_of[{at.x(), at.y()}].push_back(static_cast<uint32_t>(f));
  }
  return faces_of;
}

Status ChooseViews(const MeshSpans& whole, const CityReader& city, const CellViewOptions& options,
                   const TaskControl& control, const std::string& scratch_folder, Survey* survey) {
  std::map<std::pair<int, int>, SurveyCell*> cell_at;
  for (SurveyCell& cell : survey->cells) cell_at[{cell.x, cell.y}] = &cell;
  std::vector<Eigen::Vector3d> centres;
  for (const SceneView& view : survey->views) centres.push_back(view.camera.Centre());
  OcclusionTest occlusion(options.occlusion_margin_gsd * survey->gsd_m);
  const bool in_parts = static_cast<int64_t>(whole.faces.size()) > options.max_whole_faces;
  if (in_parts) {
    control.Report(0, "simplifying the mesh for occlusion tests");
    TESSERA_ASSIGN_OR_RETURN(const CoarseMesh coarse, CoarsenMesh(whole, kCoarseClusters, scratch_folder));
    occlusion.SetFar(coarse);
  } else {
    occlusion.SetNear(whole);
  }
  for (size_t b = 0; b < city.block_count(); ++b) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(static_cast<double>(b) / static_cast<double>(city.block_count()), "selecting views");
    TESSERA_ASSIGN_OR_RETURN(const CityBlock block, city.Block(b));
    if (in_parts) {
      TESSERA_ASSIGN_OR_RETURN(const TriangleMesh around, FacesAround(city, block.box, occlusion.near_m()));
      occlusion.SetNear(around);
    }
    std::vector<size_t> candidates;
    for (size_t v = 0; v < survey->views.size(); ++v) {
      if (MayShow(survey->views[v].camera, block.box)) candidates.push_back(v);
    }
    const auto faces_of = FacesOfCells(block, survey->ground);
    std::vector<std::pair<SurveyCell*, const std::vector<uint32_t>*>> cells;
    for (const auto& [at, faces] : faces_of) cells.emplace_back(cell_at.at(at), &faces);
    ParallelForEach(cells.size(), 1, [&](int64_t c) {
      if (!control.Check().ok()) return;
      cells[c].first->views =
          ChooseViewsOfCell(block.mesh, *cells[c].second, occlusion, centres, candidates, *survey, options);
    });
  }
  return control.Check();
}

}  // namespace tessera
