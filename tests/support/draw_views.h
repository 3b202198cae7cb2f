// Face maps of whole meshes.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "common/base/parallel.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Draws the views on all threads, those that are left over on several. `boxes`: of the mesh at its current vertex
// positions. `maps` grows if it is shorter.
inline void DrawViews(const TriangleMesh& mesh, const CellBoxes& boxes, std::span<const CameraWindow> windows,
                      Rasterizer* rasterizer, std::vector<FaceMap>* maps, double near_m = kNearPlane_m) {
  maps->resize(std::max(maps->size(), windows.size()));
  const int threads_each = windows.empty() ? 1 : ThreadCount() / static_cast<int>(windows.size());
  ParallelForEach(windows.size(), 1, [&](size_t i) {
    rasterizer->DrawPart(mesh, boxes.InWindow(windows[i], near_m), windows[i], &(*maps)[i], near_m, {}, threads_each);
  });
}

inline FaceMap RasterizeFaces(const TriangleMesh& mesh, const CameraWindow& window, double near_m = kNearPlane_m) {
  Rasterizer rasterizer;
  std::vector<FaceMap> maps;
  DrawViews(mesh, CellBoxes(mesh), {&window, 1}, &rasterizer, &maps, near_m);
  return maps[0];
}

}  // namespace tessera
