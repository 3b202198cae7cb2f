#include "worker/publish/tile_meshes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "worker/publish/flipped_faces.h"

namespace tessera {
namespace {

using nlohmann::json;

json VectorToJson(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

StatusOr<json> WriteTileMesh(const std::string& output_dir, const CityReader& city, const Survey& survey,
                             const CellRect& rect, const CoreSpans& core) {
  TESSERA_ASSIGN_OR_RETURN(CollectedFaces tile, FacesOfCore(city, survey.ground, rect, core));
  for (const FlippedFace& flipped : core.flipped) tile.mesh.faces[flipped.face] = flipped.vertices;
  PlyLayout layout;
  layout.vertices = static_cast<int64_t>(core.positions.size());
  layout.faces = static_cast<int64_t>(core.face_ids.size());
  layout.has_labels = layout.has_confidence = true;
  for (const SceneClass& c : survey.classes) layout.label_colors_rgb.push_back(c.color_rgb);
  const std::string name = TileMeshName(rect);
  TESSERA_ASSIGN_OR_RETURN(PlyStream mesh, PlyStream::Create(output_dir + "/" + name, layout));
  Eigen::AlignedBox3d box;
  const Eigen::Matrix3d scene_from_local = survey.rotation_local_from_scene.transpose();
  for (const Eigen::Vector3d& position : core.positions) {
    const Eigen::Vector3d p_in_scene = scene_from_local * position + survey.origin_in_scene;
    box.extend(p_in_scene);
    mesh.AddVertex(p_in_scene);
  }
  std::vector<int64_t> faces_of(survey.classes.size() + 1, 0);
  for (size_t f = 0; f < core.face_ids.size(); ++f) {
    mesh.AddFace({tile.mesh.faces[f], core.labels[f], core.confidence[f], 0});
    const int32_t label = core.labels[f];
    ++faces_of[label < 0 ? survey.classes.size() : static_cast<size_t>(label)];
  }
  TESSERA_RETURN_IF_ERROR(mesh.Finish());
  json classes = json::object();
  for (size_t l = 0; l < survey.classes.size(); ++l) classes[survey.classes[l].name] = faces_of[l];
  if (faces_of.back() > 0) classes["unlabelled"] = faces_of.back();
  const double cell_m = survey.ground.cell_m;
  return json{{"file", name.substr(name.rfind('/') + 1)},
              {"tile", core.tile},
              {"vertices", layout.vertices},
              {"faces", layout.faces},
              {"faces_of_class", classes},
              {"core_cells", {rect.x0, rect.y0, rect.x1, rect.y1}},
              {"core_m", {rect.x0 * cell_m, rect.y0 * cell_m, rect.x1 * cell_m, rect.y1 * cell_m}},
              {"box_min", VectorToJson(box.min())},
              {"box_max", VectorToJson(box.max())}};
}

// Size of the intersection of two ascending lists.
int64_t CountShared(std::span<const uint32_t> a, std::span<const uint32_t> b) {
  int64_t count = 0;
  for (const uint32_t id : a) count += std::binary_search(b.begin(), b.end(), id);
  return count;
}

}  // namespace

std::string TileMeshName(const CellRect& core) {
  return absl::StrCat(kTileMeshFolder, "/", core.x0, "_", core.y0, ".ply");
}

StatusOr<std::vector<std::string>> WriteTileMeshes(const std::string& output_dir, const CityReader& city,
                                                   const Survey& survey, const std::vector<TileParameters>& tiles,
                                                   const std::vector<CoreSpans>& cores,
                                                   std::span<const uint32_t> outdated,
                                                   const std::vector<int>& quarantined, const TaskControl& control) {
  TESSERA_RETURN_IF_ERROR(EnsureFolder(absl::StrCat(output_dir, "/", kTileMeshFolder)));
  std::vector<std::string> names;
  json entries = json::array();
  for (size_t t = 0; t < tiles.size(); ++t) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(static_cast<double>(t) / static_cast<double>(tiles.size()), "writing tiles");
    TESSERA_ASSIGN_OR_RETURN(json entry, WriteTileMesh(output_dir, city, survey, tiles[t].core, cores[t]));
    if (!outdated.empty()) entry["outdated_faces"] = CountShared(cores[t].face_ids, outdated);
    if (std::binary_search(quarantined.begin(), quarantined.end(), tiles[t].tile)) entry["quarantined"] = true;
    entries.push_back(std::move(entry));
    names.push_back(TileMeshName(tiles[t].core));
  }
  const json index = {{"scene", survey.scene_name},
                      {"cell_m", survey.ground.cell_m},
                      {"ground_axis_x", VectorToJson(survey.ground.axis_x)},
                      {"ground_axis_y", VectorToJson(survey.ground.axis_y)},
                      {"local_origin_in_scene", VectorToJson(survey.origin_in_scene)},
                      {"tiles", std::move(entries)}};
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(absl::StrCat(output_dir, "/", kTileIndexFile), index.dump(2) + "\n"));
  names.push_back(kTileIndexFile);
  return names;
}

}  // namespace tessera
