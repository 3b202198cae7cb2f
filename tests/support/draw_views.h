// Face maps of whole meshes.
#pragma once

#include <span>
#include <vector>

#include "worker/visibility/rasterizer.h"

namespace tessera {

// `boxes`: of the mesh at its current vertex positions.
inline void DrawViews(const TriangleMesh& mesh, const CellBoxes& boxes, std::span<const CameraWindow> windows,
                      Rasterizer* rasterizer, std::vector<FaceMap>* maps, double near_m = kNearPlane_m) {
  std::vector<MeshPart> parts;
  for (const CameraWindow& window : windows) parts.push_back(boxes.InWindow(window, near_m));
  rasterizer->DrawParts(mesh, parts, windows, maps, near_m);
}

inline FaceMap RasterizeFaces(const TriangleMesh& mesh, const CameraWindow& window, double near_m = kNearPlane_m) {
  Rasterizer rasterizer;
  std::vector<FaceMap> maps;
  DrawViews(mesh, CellBoxes(mesh), {&window, 1}, &rasterizer, &maps, near_m);
  return maps[0];
}

}  // namespace tessera
