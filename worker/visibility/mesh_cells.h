// Spatial cells of a mesh with bounding boxes, to skip what a camera window cannot show.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <functional>
#include <limits>
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

// Calls body(begin, end) for parts of at most `grain` elements of the ranges, on all threads, in one loop: the cells
// that a view shows are many short ranges.
void ForRanges(const std::vector<std::array<uint32_t, 2>>& ranges, int64_t grain,
               const std::function<void(int64_t begin, int64_t end)>& body);

// FaceMap::face at pixels where a view sees a face for which it is not selected.
inline constexpr int32_t kNotSelected = std::numeric_limits<int32_t>::min();

// The groups of faces for which a view is selected. Null pointers: it is selected for all faces.
struct FaceSelection {
  const uint32_t* group_of_face = nullptr;
  const uint8_t* selected = nullptr;  // flag per group

  // What a face map has where it shows the face.
  int32_t NameOf(uint32_t face) const {
    return selected == nullptr || selected[group_of_face[face]] ? static_cast<int32_t>(face) : kNotSelected;
  }
};

// Cells that share a bounding box, for early rejection.
inline constexpr size_t kRunCells = 16;
// Bounds of so many consecutive boxes each.
std::vector<Eigen::AlignedBox3d> RunsOf(const std::vector<Eigen::AlignedBox3d>& boxes);

// A box that a window may show, and where (BoundPixels).
struct BoxPixels {
  uint32_t box = 0;
  PixelRect pixels;
};
// The boxes that the window may show, ascending. `runs`: of RunsOf.
std::vector<BoxPixels> BoxesInWindow(const CameraWindow& window, const std::vector<Eigen::AlignedBox3d>& boxes,
                                     const std::vector<Eigen::AlignedBox3d>& runs, double near_m);

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
  std::vector<Eigen::AlignedBox3d> boxes_, runs_;  // of cells, and of kRunCells cells
  MeshPart all_;
};

}  // namespace tessera
