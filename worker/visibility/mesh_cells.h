// Runs of a mesh that lie close together, so that what a window cannot show need not be drawn.
#ifndef TESSERA_WORKER_VISIBILITY_MESH_CELLS_H_
#define TESSERA_WORKER_VISIBILITY_MESH_CELLS_H_

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"
#include "worker/visibility/image_window.h"

namespace tessera {

// Cells of a mesh whose faces and vertices come cell by cell. Without cells the mesh is one.
struct MeshCells {
  std::vector<uint32_t> face_begin, vertex_begin;   // of each cell, and the end
  std::vector<std::vector<uint32_t>> vertex_cells;  // of each cell those whose vertices its faces use, ascending
  size_t size() const { return vertex_cells.size(); }
};

// `vertex_cells` from the faces and the runs.
void FindVertexCells(const std::vector<Triangle>& faces, MeshCells* cells);

// Some of a mesh: ascending half-open ranges of faces, and of the vertices that these use (and perhaps others).
struct MeshPart {
  std::vector<std::array<uint32_t, 2>> faces, vertices;
};

// Boxes around the cells' faces as they lie. `cells` must outlive it; null: the whole mesh, whatever the window.
class CellBoxes {
 public:
  explicit CellBoxes(const TriangleMesh& mesh, const MeshCells* cells = nullptr);
  // Every face with a pixel in the window, and such as have none: whole cells, by their boxes' corners.
  MeshPart InWindow(const CameraWindow& window, double near_m) const;
  // Of these cells, ascending.
  MeshPart PartOf(const std::vector<uint32_t>& cells) const;
  const std::vector<Eigen::AlignedBox3d>& boxes() const { return boxes_; }

 private:
  const MeshCells* cells_;
  std::vector<Eigen::AlignedBox3d> boxes_;
  MeshPart all_;
};

// The pixels of a window that may show something of a box, with a margin, rounding included; all of the window for a
// box that reaches nearer than `near_m`.
PixelRect PixelsOf(const CameraWindow& view, const Eigen::AlignedBox3d& box, double near_m, int margin_px);

}  // namespace tessera

#endif  // TESSERA_WORKER_VISIBILITY_MESH_CELLS_H_
