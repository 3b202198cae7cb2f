// Spatial cells of a mesh with bounding boxes, to skip what a camera window cannot show.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"
#include "worker/visibility/image_window.h"

namespace tessera {

// Cells of a mesh whose faces and vertices are sorted by cell.
struct MeshCells {
  std::vector<uint32_t> face_begin, vertex_begin;   // first index of each cell, and the total at the end
  std::vector<std::vector<uint32_t>> vertex_cells;  // per cell: cells whose vertices its faces use, ascending
  size_t size() const { return vertex_cells.size(); }
};

// Fills `vertex_cells` from `faces` and the begin indices.
void FindVertexCells(const std::vector<Triangle>& faces, MeshCells* cells);

// A subset of a mesh: ascending half-open ranges of faces, and vertex ranges that contain all vertices of these
// faces.
struct MeshPart {
  std::vector<std::array<uint32_t, 2>> faces, vertices;
};

// Bounding boxes of the cells' faces at their current positions. `cells` must outlive the object; null: the mesh is
// one cell, and InWindow always returns all of it.
class CellBoxes {
 public:
  explicit CellBoxes(const TriangleMesh& mesh, const MeshCells* cells = nullptr);
  // All cells whose box projects into the window: a superset of the faces that have a pixel there.
  MeshPart InWindow(const CameraWindow& window, double near_m) const;
  // The faces and vertices of `cells` (ascending).
  MeshPart PartOf(const std::vector<uint32_t>& cells) const;
  const std::vector<Eigen::AlignedBox3d>& boxes() const { return boxes_; }

 private:
  const MeshCells* cells_;
  std::vector<Eigen::AlignedBox3d> boxes_;
  MeshPart all_;
};

// Bounds of the pixels of a window that may show something of a box, grown by `margin_px` and by rounding. The whole
// window if the box reaches closer than `near_m`.
PixelRect PixelsOf(const CameraWindow& view, const Eigen::AlignedBox3d& box, double near_m, int margin_px);

}  // namespace tessera
