// Sheets: the parts in which a city is exported.
#pragma once

#include <Eigen/Core>
#include <array>
#include <compare>
#include <cstdint>
#include <string>
#include <tuple>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/job/ground.h"

namespace tessera {

using Rgb = std::array<uint8_t, 3>;

// Side of a sheet in ground cells: about 1,000 GSD. A power of two, so that sheets are nodes of a quadtree.
inline constexpr int kSheetCells = 16;

// A square of kSheetCells x kSheetCells ground cells. Sheets depend on the ground grid alone, not on the job's tiles.
struct SheetId {
  int x = 0, y = 0;  // cells [16 x, 16 x + 16) by [16 y, 16 y + 16)
  bool operator==(const SheetId&) const = default;
  // By y, then x, as sheets are listed everywhere.
  auto operator<=>(const SheetId& other) const { return std::tie(y, x) <=> std::tie(other.y, other.x); }
};

// The sheet of a ground cell.
SheetId SheetOf(const Eigen::Vector2i& cell);
CellRect CellsOf(const SheetId& id);
// "3_-1": part of file names.
std::string SheetName(const SheetId& id);

// The faces of one sheet. A face belongs to the sheet of its centroid; vertices on the border are in all sheets whose
// faces use them, equal bit for bit. Vertices and faces are in the order of the city's mesh, so that a sheet has the
// same bytes for any tiling, and in an update that does not change it.
struct Sheet {
  std::vector<Eigen::Vector3d> vertices;  // metres, the job's local frame
  std::vector<Triangle> faces;            // indices into `vertices`
  std::vector<int32_t> labels;            // per face: class index; -1: none
  std::vector<float> confidence;          // per face, of its label, in [0, 1]; empty: not known
  std::vector<float> displacement_m;      // per vertex: distance to the start mesh; empty: not known
  std::vector<Rgb> colors;                // per vertex, from the photographs; empty: not computed
  std::vector<uint8_t> shared;            // per vertex: 1 if faces of other sheets use it, else 0; empty: not known

  MeshSpans mesh() const { return {vertices, faces, labels}; }
};

// Writes an array file, atomically.
Status WriteSheet(const std::string& path, const Sheet& sheet);
// DATA_LOSS if the file is damaged, an index is out of range, or an array has another size.
StatusOr<Sheet> ReadSheet(const std::string& path);

}  // namespace tessera
