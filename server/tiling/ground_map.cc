#include "server/tiling/ground_map.h"

#include <set>

#include "server/tiling/cell_index.h"

namespace tessera {

GroundRect RectOnGround(const CellRect& cells, const GroundPlane& ground) {
  return {cells.x0 * ground.cell_m, cells.y0 * ground.cell_m, cells.x1 * ground.cell_m, cells.y1 * ground.cell_m};
}

GroundMap MakeGroundMap(const Survey& survey, const std::vector<CellRect>& cores) {
  GroundMap map;
  const CellIndex cells(survey);
  for (const CellRect& core : cores) {
    MapTile& tile = map.tiles.emplace_back();
    if (core.empty()) continue;
    tile.core = {RectOnGround(core, survey.ground)};
    std::set<int32_t> views;
    cells.ForEachIn(core, [&](const SurveyCell& cell) { views.insert(cell.views.begin(), cell.views.end()); });
    tile.views.assign(views.begin(), views.end());
  }
  const Eigen::Matrix3d scene_from_local = survey.rotation_local_from_scene.transpose();
  for (const SceneView& view : survey.views) {
    const Eigen::Vector3d centre = view.camera.Centre();
    const Eigen::Vector3d axis = view.camera.rotation_cam_from_world.row(2).transpose();
    map.views.push_back({view.image_path, scene_from_local * centre + survey.origin_in_scene, scene_from_local * axis,
                         survey.ground.Coordinates(centre), survey.ground.Coordinates(axis)});
  }
  return map;
}

}  // namespace tessera
