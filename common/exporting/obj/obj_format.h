// The export format `obj`: OBJ files with the names, system and offset of the source's tiles, for programs that
// texture them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/export_format.h"

namespace tessera {

// Without tiles of a source, a city of at most this many faces is one file, mesh.obj. A larger one has a file a sheet.
inline constexpr int64_t kMaxFacesOfObj = 10'000'000;

// Refuses names of tiles that cannot be names of files (ObjTilePaths).
Status CheckObjExport(const ExportOptions& options, const ExportScene& scene);

// Writes kPartFile: the sheet's faces in coordinates of the files, cut at the source's tiles. Returns no names.
StatusOr<std::vector<std::string>> WriteObjSheet(const SheetInput& input, const std::string& folder,
                                                 const TaskControl& control);

// Writes
//   Data/Tile_+001_+002/Tile_+001_+002.obj  of each tile of the source that has faces (ObjTilePaths), or
//   mesh.obj                                without tiles; of more than kMaxFacesOfObj faces: Data/Tile_+003_-001/...
//   of
//                                           each sheet
//   metadata.xml                            system and offset, as ContextCapture writes them
//   classes.mtl, classes.json               with class_materials: beside each OBJ; for `tessera import --classes`
// Coordinates have nine decimals. Vertices that sheets share are written once a file; those that files share are equal.
// With class_materials the faces of a sheet are grouped by class. Memory: a sheet, and the vertices that sheets of a
// file share. DATA_LOSS if a part is damaged.
StatusOr<std::vector<std::string>> JoinObj(const JoinInput& input, const std::string& folder,
                                           const TaskControl& control);
// The same with another number of faces in place of kMaxFacesOfObj.
StatusOr<std::vector<std::string>> JoinObjUpTo(int64_t max_faces, const JoinInput& input, const std::string& folder,
                                               const TaskControl& control);

}  // namespace tessera
