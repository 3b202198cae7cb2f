#include "worker/tasks/tile_files.h"

#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/tile/array_file.h"
#include "common/tile/survey.h"
#include "worker/tasks/mesh_arrays.h"

namespace tessera {
namespace {

using nlohmann::json;

json VectorToJson(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }
Eigen::Vector3d VectorFromJson(const json& j) {
  return Eigen::Vector3d(j.at(0).get<double>(), j.at(1).get<double>(), j.at(2).get<double>());
}

// Runs `read` on the file's metadata.
template <class Read>
Status ReadMetadata(const ArrayFile& file, const Read& read) {
  try {
    read(json::parse(file.metadata));
    return absl::OkStatus();
  } catch (const json::exception& e) {
    return absl::DataLossError(file.name + ": metadata: " + e.what());
  }
}

}  // namespace

Status WriteTilePackage(const std::string& path, const TilePackage& p) {
  ArrayFile file;
  file.metadata = json{
      {"tile", p.tile},
      {"ground_axis_x", VectorToJson(p.ground.axis_x)},
      {"ground_axis_y", VectorToJson(p.ground.axis_y)},
      {"cell_m", p.ground.cell_m},
      {"gsd_m", p.gsd_m},
      {"up", VectorToJson(p.up)},
      {"has_likelihoods", p.has_likelihoods},
      {"classes", json::parse(ClassesToJson(p.classes))},
      {"views", json::parse(ViewsToJson(p.views))},
      {"view_depths", p.view_depths},
      {"cell_views", p.cell_views},
      {"pairs",
       p.pairs}}.dump();
  PutMesh(p.mesh, "mesh", &file);
  PutMesh(p.occluders, "occluders", &file);
  file.arrays["vertex_ids"] = p.vertex_ids;
  file.arrays["face_ids"] = p.face_ids;
  file.arrays["fixed"] = p.fixed;
  file.arrays["core"] = p.core;
  file.arrays["cell"] = p.cell;
  return WriteArrayFile(path, file);
}

StatusOr<TilePackage> ReadTilePackage(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(ArrayFile file, ReadArrayFile(path));
  TilePackage p;
  std::string classes, views;
  TESSERA_RETURN_IF_ERROR(ReadMetadata(file, [&](const json& j) {
    p.tile = j.at("tile");
    p.ground.axis_x = VectorFromJson(j.at("ground_axis_x"));
    p.ground.axis_y = VectorFromJson(j.at("ground_axis_y"));
    p.ground.cell_m = j.at("cell_m");
    p.gsd_m = j.at("gsd_m");
    p.up = VectorFromJson(j.at("up"));
    p.has_likelihoods = j.at("has_likelihoods");
    p.pairs = j.at("pairs").get<std::vector<std::array<int32_t, 2>>>();
    p.view_depths = j.at("view_depths").get<std::vector<std::array<double, 2>>>();
    p.cell_views = j.at("cell_views").get<std::vector<std::vector<int32_t>>>();
    classes = j.at("classes").dump();
    views = j.at("views").dump();
  }));
  TESSERA_ASSIGN_OR_RETURN(p.classes, ParseClasses(classes));
  TESSERA_ASSIGN_OR_RETURN(p.views, ParseViews(views));
  if (p.view_depths.size() != p.views.size()) {
    return absl::DataLossError(
        absl::StrCat(path, ": found ", p.view_depths.size(), " depths of ", p.views.size(), " views"));
  }
  TESSERA_ASSIGN_OR_RETURN(p.mesh, TakeMesh("mesh", &file));
  TESSERA_ASSIGN_OR_RETURN(p.occluders, TakeMesh("occluders", &file));
  const int64_t vertices = static_cast<int64_t>(p.mesh.vertices.size());
  const int64_t faces = static_cast<int64_t>(p.mesh.faces.size());
  TESSERA_ASSIGN_OR_RETURN(p.vertex_ids, file.Take<uint32_t>("vertex_ids", vertices));
  TESSERA_ASSIGN_OR_RETURN(p.face_ids, file.Take<uint32_t>("face_ids", faces));
  TESSERA_ASSIGN_OR_RETURN(p.fixed, file.Take<uint8_t>("fixed", vertices));
  TESSERA_ASSIGN_OR_RETURN(p.core, file.Take<uint8_t>("core", faces));
  TESSERA_ASSIGN_OR_RETURN(p.cell, file.Take<uint32_t>("cell", faces));
  return p;
}

Status WriteTileResult(const std::string& path, const TileResult& r) {
  ArrayFile file;
  file.metadata = json{{"tile", r.tile},
                       {"classes", r.classes},
                       {"part_way", r.beliefs.empty()},
                       {"in_level", !r.level_start.empty()},
                       {"report", json::parse(r.report)}}
                      .dump();
  file.arrays["vertex_ids"] = r.vertex_ids;
  file.arrays["face_ids"] = r.face_ids;
  PutPoints(r.positions, "positions", &file);
  PutPoints(r.level_start, "level_start", &file);
  file.arrays["labels"] = r.labels;
  file.arrays["beliefs"] = r.beliefs;
  file.arrays["seen"] = r.seen;
  return WriteArrayFile(path, file);
}

StatusOr<TileResult> ReadTileResult(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(ArrayFile file, ReadArrayFile(path));
  TileResult r;
  bool part_way = false, in_level = false;
  TESSERA_RETURN_IF_ERROR(ReadMetadata(file, [&](const json& j) {
    r.tile = j.at("tile");
    r.classes = j.at("classes");
    r.report = j.at("report").dump();
    part_way = j.at("part_way");
    in_level = j.at("in_level");
  }));
  TESSERA_ASSIGN_OR_RETURN(r.vertex_ids, file.Take<uint32_t>("vertex_ids"));
  TESSERA_ASSIGN_OR_RETURN(r.face_ids, file.Take<uint32_t>("face_ids"));
  const int64_t vertices = static_cast<int64_t>(r.vertex_ids.size()), faces = static_cast<int64_t>(r.face_ids.size());
  TESSERA_ASSIGN_OR_RETURN(r.positions, TakePoints("positions", vertices, &file));
  TESSERA_ASSIGN_OR_RETURN(r.level_start, TakePoints("level_start", in_level ? vertices : 0, &file));
  TESSERA_ASSIGN_OR_RETURN(r.labels, file.Take<int32_t>("labels", faces));
  TESSERA_ASSIGN_OR_RETURN(r.beliefs, file.Take<float>("beliefs", part_way ? 0 : faces * r.classes));
  TESSERA_ASSIGN_OR_RETURN(r.seen, file.Take<uint8_t>("seen", part_way ? 0 : faces));
  return r;
}

StatusOr<std::vector<TileResult>> ReadTileResults(const std::string& input_dir,
                                                  const std::vector<TileParameters>& tiles) {
  std::vector<TileResult> results;
  for (const TileParameters& tile : tiles) {
    TESSERA_ASSIGN_OR_RETURN(TileResult result,
                             ReadTileResult(input_dir + "/" + TileInputName(tile.tile, kResultFile)));
    results.push_back(std::move(result));
  }
  return results;
}

Status WriteTileCore(const std::string& path, const TileCore& c) {
  ArrayFile file;
  file.metadata = json{{"tile", c.tile}, {"report", json::parse(c.report)}}.dump();
  file.arrays["vertex_ids"] = c.vertex_ids;
  PutPoints(c.positions, "positions", &file);
  file.arrays["face_ids"] = c.face_ids;
  file.arrays["labels"] = c.labels;
  file.arrays["confidence"] = c.confidence;
  return WriteArrayFile(path, file);
}

StatusOr<TileCore> ReadTileCore(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(ArrayFile file, ReadArrayFile(path));
  TileCore c;
  TESSERA_RETURN_IF_ERROR(ReadMetadata(file, [&](const json& j) {
    c.tile = j.at("tile");
    c.report = j.at("report").dump();
  }));
  TESSERA_ASSIGN_OR_RETURN(c.vertex_ids, file.Take<uint32_t>("vertex_ids"));
  TESSERA_ASSIGN_OR_RETURN(c.positions, TakePoints("positions", static_cast<int64_t>(c.vertex_ids.size()), &file));
  TESSERA_ASSIGN_OR_RETURN(c.face_ids, file.Take<uint32_t>("face_ids"));
  const int64_t faces = static_cast<int64_t>(c.face_ids.size());
  TESSERA_ASSIGN_OR_RETURN(c.labels, file.Take<int32_t>("labels", faces));
  TESSERA_ASSIGN_OR_RETURN(c.confidence, file.Take<float>("confidence", faces));
  return c;
}

}  // namespace tessera
