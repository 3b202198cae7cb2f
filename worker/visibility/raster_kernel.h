// Inner loops of the rasteriser: project vertices to a fixed-point grid, drop faces without pixel centres, draw the
// rest. They use the widest instruction set of the machine and give the same bytes on each.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>

#include "common/geometry/mesh.h"
#include "worker/visibility/image_window.h"
#include "worker/visibility/mesh_cells.h"

namespace tessera {

// Vertices are rounded to a grid of 2^-15 pixel. The side of an edge on which a pixel centre lies is then an exact
// integer test, with the same result for both faces of the edge.
constexpr int kGridBits = 15;
constexpr int64_t kGridPerPixel = int64_t{1} << kGridBits;
constexpr int64_t kGridHalf = kGridPerPixel / 2;
constexpr double kGridLimit = int64_t{1} << 30;

// A projected vertex.
struct alignas(16) GridVertex {
  int32_t x = 0, y = 0;  // grid units from the window's first pixel; below kGridLimit from the image's
  float inverse_z = 0;   // affine over the image of a plane
  int32_t off_grid = 0;  // -1: closer than the near plane or outside the grid, other fields are 0; else 0
};

// A projected vertex that is not rounded to the grid.
struct ImageVertex {
  double x = 0, y = 0;   // pixels of the whole image, so that all windows give the same bytes
  double inverse_z = 0;  // 0: closer than the near plane or outside the grid, other fields are 0
};

// Rows [row_first, row_last) of a face map. The pointers refer to the map's first pixel.
struct DrawTarget {
  int width = 0, height = 0;
  int x0 = 0, y0 = 0;  // position of the first pixel in the whole image
  int row_first = 0, row_last = 0;
  int32_t* face = nullptr;
  float* inverse_z = nullptr;  // 0: no surface
  FaceSelection selection = {};

  void Draw(int x, int y, float value, int32_t id) const {
    const size_t i = static_cast<size_t>(y) * width + x;
    if (value > inverse_z[i]) {
      inverse_z[i] = value;
      face[i] = id;
    }
  }
};

// Interpolates 1/z over the image of a face with corners a, b, c. The arguments of At are the areas that the point
// spans with the edges opposite b and c. The result is clamped to the corners' range, so thin faces do not
// extrapolate.
struct DepthPlane {
  double at_a = 0, for_b = 0, for_c = 0;
  float low = 0, high = 0;

  DepthPlane(double a, double b, double c, double area)
      : at_a(a),
        for_b((b - a) / area),
        for_c((c - a) / area),
        low(static_cast<float>(std::min(a, std::min(b, c)))),
        high(static_cast<float>(std::max(a, std::max(b, c)))) {}
  float At(double area_b, double area_c) const {
    const float value = static_cast<float>(at_a + (area_b * for_b + area_c * for_c));
    return std::min(std::max(value, low), high);
  }
};

// Rounds in coordinates of the whole image, so that all windows give the same vertices.
void ProjectToGrid(const Eigen::Vector3d* vertices, int64_t count, const CameraWindow& window, double near_m,
                   GridVertex* out);

void ProjectToImage(const Eigen::Vector3d* vertices, int64_t count, const PosedCamera& camera, double near_m,
                    ImageVertex* out);

// Writes to `list` (room for last - first) the faces of [first, last), ascending, whose bounding box contains a pixel
// centre of the window or that have a vertex off the grid. Returns their number.
int64_t SelectFaces(const Triangle* faces, int64_t first, int64_t last, const GridVertex* vertices, int width,
                    int height, uint32_t* list);

// Draws the listed faces in order; of equally near faces the first stays. Stops at a face that is off the grid or too
// large for it, to be drawn by DrawUnboundedFace. Returns how many entries of the list it has drawn.
int64_t DrawFaces(const Triangle* faces, const uint32_t* list, int64_t count, const GridVertex* vertices,
                  const DrawTarget& target);

}  // namespace tessera
