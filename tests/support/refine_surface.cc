#include "tests/support/refine_surface.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "common/job/refine_steps.h"

namespace tessera {
namespace {

constexpr uint8_t kAllRegions = kCoreRegion | kSolveRegion | kRepairRegion | kLabelRegion;

std::vector<uint32_t> Ids(size_t count) {
  std::vector<uint32_t> ids(count);
  std::iota(ids.begin(), ids.end(), 0u);
  return ids;
}

// One cell that all views chose.
TilePackage PackageOf(const SurfaceProblem& problem, const std::vector<ViewPair>& pairs) {
  TilePackage package;
  package.gsd_m = problem.gsd_m;
  package.up = problem.up;
  package.mesh = problem.mesh;
  const std::vector<int32_t>& labels = problem.mesh.labels;
  package.has_labels = !labels.empty();
  if (labels.empty()) {
    package.mesh.labels.assign(problem.mesh.faces.size(), -1);
  } else {
    package.classes.resize(static_cast<size_t>(*std::max_element(labels.begin(), labels.end())) + 1);
  }
  package.has_pairs = !pairs.empty();
  for (size_t v = 0; v < problem.views.size(); ++v) {
    const RefineView& view = problem.views[v];
    package.views.emplace_back();
    package.views.back().camera = view.camera;
    package.view_ids.push_back(view.id);
    package.view_rects.push_back(view.pixels->rect());
    package.view_depths.push_back({view.depths.near_m, view.depths.far_m});
  }
  for (const ViewPair& pair : pairs) package.pairs.push_back({pair.reference, pair.other});
  const auto vertices = static_cast<uint32_t>(problem.mesh.vertices.size());
  const auto faces = static_cast<uint32_t>(problem.mesh.faces.size());
  package.cell_at = {{0, 0}};
  package.cell_views.emplace_back(problem.views.size());
  std::iota(package.cell_views[0].begin(), package.cell_views[0].end(), 0);
  package.cells.face_begin = {0, faces};
  package.cells.vertex_begin = {0, vertices};
  FindVertexCells(package.mesh.faces, &package.cells);
  package.vertex_ids = Ids(vertices);
  package.face_ids = Ids(faces);
  package.regions.assign(faces, kAllRegions);
  package.cut_regions.assign(vertices, 0);
  for (size_t v = 0; v < problem.boundary.size(); ++v) {
    if (problem.boundary[v]) package.cut_regions[v] = kAllRegions;
  }
  return package;
}

}  // namespace

StatusOr<SurfaceRefinement> RefineSurface(const SurfaceProblem& problem, const TileRefineOptions& options,
                                          const TaskControl& control, const Clock& clock) {
  std::vector<ViewPair> pairs = problem.pairs;
  if (pairs.empty()) {
    std::vector<PosedCamera> cameras;
    for (const RefineView& view : problem.views) cameras.push_back(view.camera);
    pairs = SelectPairs(problem.mesh, cameras, problem.pairing);
  }
  TileWorkspace work(PackageOf(problem, pairs));
  std::vector<RefineView> views = problem.views;
  for (size_t v = 0; v < views.size(); ++v) views[v].index = static_cast<int>(v);
  TileImages images(work.package(), std::move(views), options);
  std::vector<RefineStep> steps;
  for (int round = 0; round < problem.rounds; ++round) {
    for (RefineStep step : MakeRefineSteps(problem.levels, problem.iterations, 1, false, false)) {
      step.round = round;
      if (!step.labels()) steps.push_back(step);
    }
  }
  SurfaceRefinement out;
  TESSERA_ASSIGN_OR_RETURN(out.tile, RefineTile(work, images, TileStepsOf(steps), options, /*start=*/nullptr,
                                                /*to_end=*/true, control, clock));
  out.vertices = out.tile.state.positions;
  out.pairs = static_cast<int>(pairs.size());
  return out;
}

}  // namespace tessera
