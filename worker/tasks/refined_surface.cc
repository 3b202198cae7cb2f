#include "worker/tasks/refined_surface.h"

#include <span>

namespace tessera {
namespace {

// Calls found(i, index) for each element of `some` that is in `all`, with its index there. Both ascend.
template <class Found>
void ForShared(std::span<const uint32_t> some, const std::vector<uint32_t>& all, const Found& found) {
  size_t place = 0;
  for (size_t i = 0; i < some.size(); ++i) {
    while (place < all.size() && all[place] < some[i]) ++place;
    if (place == all.size()) return;
    if (all[place] == some[i]) found(i, place);
  }
}

}  // namespace

Eigen::AlignedBox2d PlanOf(const CellRect& cells, double cell_m, int margin_cells) {
  const Eigen::Vector2d low(cells.x0 - margin_cells, cells.y0 - margin_cells),
      high(cells.x1 + margin_cells, cells.y1 + margin_cells);
  return {low * cell_m, high * cell_m};
}

StatusOr<CollectedFaces> RefinedSurface(const CityReader& city, const GroundPlane& ground,
                                        const Eigen::AlignedBox2d& plan, const std::vector<MappedState>& states) {
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
  for (const MappedState& state : states) {
    const StateSpans& spans = state.spans();
    ForShared(spans.vertex_ids, found.vertex_ids,
              [&](size_t i, size_t v) { found.mesh.vertices[v] = spans.positions[i]; });
    ForShared(spans.face_ids, found.face_ids, [&](size_t i, size_t f) { found.mesh.labels[f] = spans.labels[i]; });
  }
  return found;
}

}  // namespace tessera
