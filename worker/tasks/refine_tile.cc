#include "worker/tasks/refine_tile.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/geometry/topology.h"
#include "worker/tasks/stages.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

using nlohmann::json;

// What the views say of the mesh as it is now.
StatusOr<FaceLikelihoods> CollectLikelihoods(const RefineProblem& problem, int classes,
                                             const std::vector<TileView>& views, const TaskControl& control) {
  FaceLikelihoods sums(problem.mesh.faces.size(), classes);
  for (size_t v = 0; v < views.size(); ++v) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(0.8 * static_cast<double>(v) / views.size(), "collecting likelihoods");
    if (views[v].likelihoods.empty()) continue;
    FaceMap map = RasterizeFaces(problem.mesh, &problem.occluders, views[v].window);
    MarkNotLookedAt(problem.groups, v, &map);
    AddLikelihoods(map, views[v].likelihoods, views[v].mapping, &sums);
  }
  return sums;
}

// Beliefs of labels that nothing was asked about: they stay.
std::vector<float> CertainBeliefs(const std::vector<int32_t>& labels, int classes) {
  std::vector<float> beliefs(labels.size() * classes, 10.0f);
  for (size_t f = 0; f < labels.size(); ++f) {
    if (labels[f] >= 0) beliefs[f * classes + labels[f]] = 0;
  }
  return beliefs;
}

int64_t CountDifferent(const std::vector<int32_t>& a, const std::vector<int32_t>& b) {
  int64_t count = 0;
  for (size_t i = 0; i < a.size(); ++i) count += a[i] != b[i];
  return count;
}

RefineProblem MakeProblem(const TilePackage& package, const std::vector<TileView>& views, bool knows_labels) {
  RefineProblem problem;
  problem.mesh = package.mesh;
  if (!knows_labels) problem.mesh.labels.clear();
  problem.fixed_vertices = package.fixed;
  problem.occluders = package.occluders;
  problem.gsd_m = package.gsd_m;
  problem.up = package.up;
  problem.reach_m = kTileReachGsd * package.gsd_m;
  problem.groups.group_of_face = package.cell;
  for (const std::vector<int32_t>& cell : package.cell_views) {
    std::vector<uint8_t> looks;
    for (const TileView& view : views) looks.push_back(std::binary_search(cell.begin(), cell.end(), view.view));
    problem.groups.looks.push_back(std::move(looks));
  }
  std::vector<int> loaded(package.views.size(), -1);
  for (size_t v = 0; v < views.size(); ++v) {
    loaded[views[v].view] = static_cast<int>(v);
    const FloatImage* likelihoods = knows_labels && !views[v].likelihoods.empty() ? &views[v].likelihoods : nullptr;
    const PixelRect& rect = views[v].window.rect;
    const auto& [near_m, far_m] = package.view_depths[views[v].view];
    problem.views.push_back({views[v].window.camera,
                             &views[v].luminance,
                             likelihoods,
                             views[v].mapping,
                             rect.x0,
                             rect.y0,
                             {static_cast<float>(near_m), static_cast<float>(far_m)}});
  }
  for (const auto& [reference, other] : package.pairs) {
    if (loaded[reference] >= 0 && loaded[other] >= 0) problem.pairs.push_back({loaded[reference], loaded[other]});
  }
  return problem;
}

}  // namespace

StatusOr<TileRefinement> RefineTile(const TilePackage& package, const std::vector<TileView>& views,
                                    const TileRefineOptions& options, const TaskControl& control, const Clock& clock) {
  const int classes = static_cast<int>(package.classes.size());
  const bool label = package.has_likelihoods && classes > 1;
  TESSERA_ASSIGN_OR_RETURN(const MeshTopology topology, BuildTopology(package.mesh));
  const std::vector<MeshEdge> edges = EdgeList(topology);
  // One class is no class: what it could say is the same everywhere.
  const bool geometry_knows_labels = options.geometry_knows_labels && classes > 1;
  RefineProblem problem = MakeProblem(package, views, geometry_knows_labels);

  TileRefinement refinement;
  TileResult& result = refinement.result;
  result.tile = package.tile;
  result.classes = classes;
  result.vertex_ids = package.vertex_ids;
  result.face_ids = package.face_ids;
  result.labels = package.mesh.labels;
  result.beliefs = CertainBeliefs(result.labels, classes);
  result.seen.assign(result.labels.size(), 1);  // labels that are carried through are not inferred

  const auto solve_labels = [&](const TaskControl& part, json* report) -> Status {
    const int64_t start_us = clock.MonotonicUs();
    TESSERA_ASSIGN_OR_RETURN(const FaceLikelihoods sums, CollectLikelihoods(problem, classes, views, part));
    part.Report(0.8, "labelling");
    Labelling labelling = SolveLabels(
        BuildLabelField(problem.mesh, edges, sums, package.classes, package.up, package.gsd_m, options.label),
        result.labels, options.solver);
    for (size_t f = 0; f < result.seen.size(); ++f) result.seen[f] = sums.pixels[f] > 0;
    (*report)["label_energy_start"] = labelling.start_energy;
    (*report)["label_energy_end"] = labelling.energy;
    (*report)["label_changes"] = CountDifferent(result.labels, labelling.labels);
    result.labels = std::move(labelling.labels);
    result.beliefs = std::move(labelling.beliefs);
    refinement.seconds_labels += SecondsSince(clock, start_us);
    return absl::OkStatus();
  };

  json tile_report = {{"faces", package.mesh.faces.size()}, {"views", views.size()}};
  // A start without any labels is given some first, for the geometry that asks for them (paper, section 3).
  const bool unlabelled = std::all_of(result.labels.begin(), result.labels.end(), [](int32_t l) { return l < 0; });
  const bool labels_first = label && (options.labels_first || (geometry_knows_labels && unlabelled));
  const double begin = labels_first ? 0.1 : 0;  // share of the work before the rounds
  if (labels_first) TESSERA_RETURN_IF_ERROR(solve_labels(PartOf(control, 0, begin), &tile_report["labels_first"]));
  json rounds = json::array();
  for (int round = 0; round < options.rounds; ++round) {
    const double share = (1 - begin) / options.rounds, low = begin + round * share, high = low + share;
    json report = json::object();
    const int64_t geometry_start_us = clock.MonotonicUs();
    if (!problem.pairs.empty()) {
      if (geometry_knows_labels) problem.mesh.labels = result.labels;
      if (round > 0) problem.start = package.mesh.vertices;
      std::vector<Eigen::Vector3d> moved;
      const TaskControl part = PartOf(control, low, low + 0.85 * (high - low));
      TESSERA_ASSIGN_OR_RETURN(const RefineReport r, RefineGeometry(problem, &moved, options.geometry, part));
      problem.mesh.vertices = std::move(moved);
      report["photo_energy_start"] = r.energy_start;
      report["photo_energy_end"] = r.energy_end;
      report["moved_rms_m"] = r.moved_rms_m;
      report["moved_max_m"] = r.moved_max_m;
      report["pairs"] = r.pairs;
      report["warped_pixels"] = r.warped_pixels;
    }
    refinement.seconds_geometry += SecondsSince(clock, geometry_start_us);
    if (label) {
      TESSERA_RETURN_IF_ERROR(solve_labels(PartOf(control, low + 0.85 * (high - low), high), &report));
    }
    rounds.push_back(std::move(report));
  }

  result.displacements.resize(package.mesh.vertices.size());
  for (size_t v = 0; v < result.displacements.size(); ++v) {
    result.displacements[v] = problem.mesh.vertices[v] - package.mesh.vertices[v];
  }
  tile_report["rounds"] = std::move(rounds);
  result.report = tile_report.dump();
  return refinement;
}

}  // namespace tessera
