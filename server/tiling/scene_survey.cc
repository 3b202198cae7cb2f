#include "server/tiling/scene_survey.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <iterator>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr size_t kViewsOfCell = 40, kPartners = 4;
constexpr size_t kSampledFaces = 50000;
// As DensityOptions of worker/refine: squared length in pixels up to which edges stay, and how often they are halved.
constexpr double kEdge_px2 = 16 * 2.3094010767585, kMaxHalvings = 8;
constexpr double kNarrowest_cos = 0.99905, kWidest_cos = 0.7071;  // 2.5 and 45 degrees, as SelectPairs

// Number of faces that a face is split into, from its longest projections.
double PartsOf(const TriangleMesh& mesh, size_t face, const std::vector<SceneView>& views) {
  double halvings = 0;
  for (int k = 0; k < 3; ++k) {
    double longest_px2 = 0;
    for (const SceneView& view : views) {
      const Eigen::Vector3d p = view.camera.Project(mesh.Corner(face, k));
      const Eigen::Vector3d q = view.camera.Project(mesh.Corner(face, (k + 1) % 3));
      if (!view.camera.InImage(p) || !view.camera.InImage(q)) continue;
      longest_px2 = std::max(longest_px2, (p - q).head<2>().squaredNorm());
    }
    halvings += std::clamp(std::ceil(0.5 * std::log2(std::max(1.0, longest_px2 / kEdge_px2))), 0.0, kMaxHalvings) / 3;
  }
  return std::exp2(2 * halvings);
}

// Multiplies the faces of each cell by the mean parts of its sampled faces; cells without a sample by that of all.
void SplitFaces(const TriangleMesh& mesh, const GroundPlane& ground, const std::vector<SceneView>& views,
                std::vector<SurveyCell>* cells) {
  const size_t stride = mesh.faces.size() / kSampledFaces + 1, samples = (mesh.faces.size() + stride - 1) / stride;
  std::vector<double> parts(samples);
  ParallelForEach(samples, 64, [&](int64_t i) { parts[i] = PartsOf(mesh, i * stride, views); });
  std::map<std::pair<int, int>, std::pair<double, int64_t>> of_cell;  // sum and number
  double sum = 0;
  for (size_t i = 0; i < samples; ++i) {
    const Eigen::Vector2i at = ground.Cell(MeshSpans(mesh).Centroid(i * stride));
    auto& [sum_of_cell, count] = of_cell[{at.x(), at.y()}];
    sum_of_cell += parts[i];
    ++count;
    sum += parts[i];
  }
  for (SurveyCell& cell : *cells) {
    const auto found = of_cell.find({cell.x, cell.y});
    const double mean = found == of_cell.end() ? sum / static_cast<double>(samples)
                                               : found->second.first / static_cast<double>(found->second.second);
    cell.faces = static_cast<int64_t>(mean * static_cast<double>(cell.faces));
  }
}

std::vector<SurveyCell> CellsOfMesh(const TriangleMesh& mesh, const GroundPlane& ground) {
  std::map<std::pair<int, int>, SurveyCell> cells;  // by y, then x
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Eigen::Vector2i at = ground.Cell(MeshSpans(mesh).Centroid(f));
    const auto [it, is_new] = cells.try_emplace({at.y(), at.x()});
    SurveyCell& cell = it->second;
    if (is_new) {
      cell.x = at.x();
      cell.y = at.y();
      cell.box_min = cell.box_max = mesh.Corner(f, 0);
    }
    ++cell.faces;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d p = mesh.Corner(f, k);
      cell.box_min = cell.box_min.cwiseMin(p);
      cell.box_max = cell.box_max.cwiseMax(p);
      const CellRect square = {cell.x, cell.y, cell.x + 1, cell.y + 1};
      cell.reach_m = std::max(cell.reach_m, DistanceToRect(ground.Coordinates(p), square, ground.cell_m));
    }
  }
  std::vector<SurveyCell> list;
  for (auto& [at, cell] : cells) list.push_back(std::move(cell));
  return list;
}

// The views whose images contain the centre of the cell's box; ascending.
std::vector<int32_t> ViewsOfCell(const SurveyCell& cell, const std::vector<SceneView>& views) {
  const Eigen::Vector3d centre = (cell.box_min + cell.box_max) / 2;
  std::vector<std::pair<double, int32_t>> seeing;  // by size of a pixel in metres
  for (size_t v = 0; v < views.size(); ++v) {
    const Eigen::Vector3d p = views[v].camera.Project(centre);
    if (views[v].camera.InImage(p)) seeing.emplace_back(p.z() / views[v].camera.intrinsics.fx, static_cast<int32_t>(v));
  }
  std::sort(seeing.begin(), seeing.end());
  seeing.resize(std::min(seeing.size(), kViewsOfCell));
  std::vector<int32_t> chosen;
  for (const auto& [metres, v] : seeing) chosen.push_back(v);
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

// Both orders of the pairs of views, ascending.
std::vector<std::array<int32_t, 2>> PairsOf(const Survey& survey) {
  std::vector<Eigen::Vector3d> centres;
  for (const SceneView& view : survey.views) centres.push_back(view.camera.Centre());
  std::vector<std::set<std::pair<double, int32_t>>> partners(centres.size());  // by distance
  for (const SurveyCell& cell : survey.cells) {
    const Eigen::Vector3d target = (cell.box_min + cell.box_max) / 2;
    for (const int32_t a : cell.views) {
      for (const int32_t b : cell.views) {
        const double cosine = (centres[a] - target).normalized().dot((centres[b] - target).normalized());
        if (a == b || cosine > kNarrowest_cos || cosine < kWidest_cos) continue;
        partners[a].emplace((centres[a] - centres[b]).norm(), b);
        if (partners[a].size() > kPartners) partners[a].erase(std::prev(partners[a].end()));
      }
    }
  }
  std::set<std::array<int32_t, 2>> pairs;
  for (size_t a = 0; a < partners.size(); ++a) {
    for (const auto& [metres, b] : partners[a]) {
      pairs.insert({static_cast<int32_t>(a), b});
      pairs.insert({b, static_cast<int32_t>(a)});
    }
  }
  return {pairs.begin(), pairs.end()};
}

}  // namespace

Survey EstimateSurvey(const SceneDescription& scene, const TriangleMesh& mesh, double gsd_m) {
  Survey survey;
  survey.scene_name = scene.name;
  survey.gsd_m = gsd_m;
  survey.up = scene.up_in_local;
  survey.ground = MakeGroundPlane(survey.up, CellSide_m(gsd_m));
  survey.views = scene.views;
  survey.classes = scene.classes;
  survey.has_likelihoods = scene.has_likelihoods;
  survey.has_labels = !mesh.labels.empty();
  survey.input_vertices = static_cast<int64_t>(mesh.vertices.size());
  survey.input_faces = static_cast<int64_t>(mesh.faces.size());
  survey.cells = CellsOfMesh(mesh, survey.ground);
  SplitFaces(mesh, survey.ground, survey.views, &survey.cells);
  survey.faces = 0;
  for (const SurveyCell& cell : survey.cells) survey.faces += cell.faces;
  ParallelForEach(survey.cells.size(), 16,
                  [&](int64_t i) { survey.cells[i].views = ViewsOfCell(survey.cells[i], survey.views); });
  survey.pairs = PairsOf(survey);
  return survey;
}

}  // namespace tessera
