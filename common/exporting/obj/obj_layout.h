// The files of an OBJ export and their coordinates.
#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/exporting/export_format.h"
#include "common/exporting/export_map.h"
#include "common/exporting/export_scene.h"

namespace tessera {

// The map to the coordinates that are written: those of `options`, else of the source, else of the scene.
StatusOr<ExportMap> OpenObjMap(const ExportScene& scene, const ExportOptions& options);

// The OBJ files of the source's tiles, without ending, in their order: Data/Tile_+001_+002/Tile_+001_+002 as
// ContextCapture has them; if some names have folders (MeshSource::tile_names), Data/NAME of all. Empty: the source has
// no tiles, or more than one whose rectangles are not known. INVALID_ARGUMENT names each tile whose name cannot be that
// of a file, or that two tiles have: names come from outside.
StatusOr<std::vector<std::string>> ObjTilePaths(const ExportScene& scene);

// The path of a tile called `name` without '/'.
std::string ObjTilePath(std::string_view name);

// Subtracted from coordinates of `map`, as in SRSOrigin. In the source's system: the source's offset. Else a place near
// the scene, in whole thousands; zero along axes with coordinates below 10,000 and for scenes without a system.
StatusOr<Eigen::Vector3d> ObjOffset(const ExportScene& scene, const ExportMap& map);

// The content of metadata.xml as ContextCapture writes it beside Data/; empty if there is neither a system nor an
// offset.
std::string ObjMetadata(const ExportMap& map, const Eigen::Vector3d& offset);

}  // namespace tessera
