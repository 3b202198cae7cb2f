#include "worker/tasks/refined_surface.h"

#include "common/job/task_parameters.h"
#include "worker/city/id_merge.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/kept/kept_files.h"

namespace tessera {

StatusOr<StatesOfTiles> OpenStates(const TaskRequest& request, const std::vector<int>& tiles) {
  StatesOfTiles states;
  for (const int tile : tiles) {
    TESSERA_ASSIGN_OR_RETURN(states.emplace_back(), OpenState(InputPath(request, TileInputName(tile, kStateFile))));
  }
  return states;
}

Eigen::AlignedBox2d PlanOf(const CellRect& cells, double cell_m, int margin_cells) {
  const Eigen::Vector2d low(cells.x0 - margin_cells, cells.y0 - margin_cells),
      high(cells.x1 + margin_cells, cells.y1 + margin_cells);
  return {low * cell_m, high * cell_m};
}

StatusOr<CollectedFaces> RefinedSurface(const CityReader& city, const GroundPlane& ground,
                                        const Eigen::AlignedBox2d& plan, const StatesOfTiles& states) {
  FaceCollector collector;
  for (size_t b = 0; b < city.block_count(); ++b) {
    Eigen::AlignedBox2d of_block;
    for (int k = 0; k < 8; ++k) {
      of_block.extend(ground.Coordinates(city.box(b).corner(static_cast<Eigen::AlignedBox3d::CornerType>(k))));
    }
    if (!of_block.intersects(plan)) continue;
    TESSERA_ASSIGN_OR_RETURN(const CityBlock block, city.Block(b));
    for (size_t f = 0; f < block.face_ids.size(); ++f) {
      Eigen::AlignedBox2d of_face;
      for (int k = 0; k < 3; ++k) of_face.extend(ground.Coordinates(block.mesh.Corner(f, k)));
      if (of_face.intersects(plan)) collector.Add(block, f);
    }
  }
  CollectedFaces found = collector.Finish();
  for (const auto& state : states) {
    const StateSpans& spans = state->spans();
    ForSharedIds(spans.vertex_ids, found.vertex_ids,
                 [&](size_t i, size_t v) { found.mesh.vertices[v] = spans.positions[i]; });
    ForSharedIds(spans.face_ids, found.face_ids, [&](size_t i, size_t f) { found.mesh.labels[f] = spans.labels[i]; });
  }
  return found;
}

}  // namespace tessera
