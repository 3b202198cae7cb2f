#include <utility>

#include "absl/strings/str_cat.h"
#include "common/exporting/obj/cut_by_rects.h"
#include "common/exporting/obj/obj_format.h"
#include "common/exporting/obj/obj_layout.h"
#include "common/exporting/obj/obj_part.h"

namespace tessera {
namespace {

// Cuts the sheet in the source's system, in which the tiles' rectangles are, and leaves the vertices there.
StatusOr<CutMesh> CutObjInSource(const SheetInput& input, const ExportMap& source_map) {
  std::vector<Eigen::Vector3d> vertices = input.sheet.vertices;
  TESSERA_RETURN_IF_ERROR(source_map.FromLocal(vertices));
  for (Eigen::Vector3d& v : vertices) v -= input.scene.source->offset;
  return CutByRects(std::move(vertices), input.sheet.faces, TileRects::Of(input.scene.source->tile_rects));
}

// From the source's system to another one: vertices of the sheet come from the sheet, so that they do not depend on
// the way through the source's system.
Status ObjToOtherSystem(const SheetInput& input, const ExportMap& source_map, const ExportMap& map, CutMesh* mesh) {
  for (Eigen::Vector3d& v : mesh->vertices) v += input.scene.source->offset;
  TESSERA_RETURN_IF_ERROR(source_map.ToLocal(mesh->vertices));
  std::copy(input.sheet.vertices.begin(), input.sheet.vertices.end(), mesh->vertices.begin());
  TESSERA_RETURN_IF_ERROR(map.FromLocal(mesh->vertices));
  TESSERA_ASSIGN_OR_RETURN(const Eigen::Vector3d offset, ObjOffset(input.scene, map));
  for (Eigen::Vector3d& v : mesh->vertices) v -= offset;
  return absl::OkStatus();
}

// The whole sheet as a part of tile 0.
StatusOr<CutMesh> WholeObjSheet(const SheetInput& input, const ExportMap& map) {
  CutMesh mesh;
  mesh.vertices = input.sheet.vertices;
  mesh.faces = input.sheet.faces;
  mesh.tiles.assign(mesh.faces.size(), 0);
  for (size_t f = 0; f < mesh.faces.size(); ++f) mesh.source_faces.push_back(static_cast<uint32_t>(f));
  TESSERA_RETURN_IF_ERROR(map.FromLocal(mesh.vertices));
  TESSERA_ASSIGN_OR_RETURN(const Eigen::Vector3d offset, ObjOffset(input.scene, map));
  for (Eigen::Vector3d& v : mesh.vertices) v -= offset;
  return mesh;
}

}  // namespace

Status CheckObjExport(const ExportOptions&, const ExportScene& scene) { return ObjTilePaths(scene).status(); }

StatusOr<std::vector<std::string>> WriteObjSheet(const SheetInput& input, const std::string& folder,
                                                 const TaskControl& control) {
  TESSERA_RETURN_IF_ERROR(control.Check());
  TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> tiles, ObjTilePaths(input.scene));
  TESSERA_ASSIGN_OR_RETURN(const ExportMap map, OpenObjMap(input.scene, input.options));
  CutMesh mesh;
  if (tiles.size() > 1) {
    TESSERA_ASSIGN_OR_RETURN(const ExportMap source_map, ExportMap::Open(input.scene, ""));
    TESSERA_ASSIGN_OR_RETURN(mesh, CutObjInSource(input, source_map));
    if (map.crs() != source_map.crs()) TESSERA_RETURN_IF_ERROR(ObjToOtherSystem(input, source_map, map, &mesh));
  } else {
    TESSERA_ASSIGN_OR_RETURN(mesh, WholeObjSheet(input, map));
  }
  const std::span<const int32_t> labels = input.sheet.labels;
  TESSERA_RETURN_IF_ERROR(WriteObjPart(absl::StrCat(folder, "/", kPartFile), mesh,
                                       input.options.class_materials ? labels : std::span<const int32_t>()));
  return std::vector<std::string>();
}

}  // namespace tessera
