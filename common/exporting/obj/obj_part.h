// The part file of a sheet: its faces by OBJ file.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/arrays/mapped_arrays.h"
#include "common/base/status.h"
#include "common/exporting/obj/cut_by_rects.h"

namespace tessera {

// What a sheet has of one tile. Spans are valid as long as the file is mapped.
struct ObjPiece {
  std::span<const double> vertices;  // x, y, z of each, coordinates of the OBJ file
  std::span<const uint32_t> faces;   // three vertices each
  std::span<const int32_t> labels;   // per face; empty without materials
  std::span<const uint8_t> is_rim;   // per vertex: 1: other sheets or tiles may have it too
};

struct ObjPieceCount {
  int32_t tile = 0;
  int64_t faces = 0;
};

// Writes the faces of `mesh` by tile; vertices without faces are left out. `labels`: per face of the sheet, by
// CutMesh::source_faces; empty: none.
Status WriteObjPart(const std::string& path, const CutMesh& mesh, std::span<const int32_t> labels);

// The tiles of a part, ascending.
StatusOr<std::vector<ObjPieceCount>> ReadObjPieceCounts(const MappedArrays& part);
StatusOr<ObjPiece> ReadObjPiece(const MappedArrays& part, int32_t tile);

}  // namespace tessera
