// The export format 3dtiles: 3D Tiles 1.1 (OGC), a quadtree of GLB files.
#pragma once

#include <string>
#include <vector>

#include "common/exporting/export_format.h"

namespace tessera {

// Sizes of tiles. Tests use others. tests/bench/tiles_bench.cc measures how many triangles a viewer draws.
struct Tiles3dSizes {
  // At most in a leaf. Tiles above the leaves may have one more for each vertex that other tiles have too.
  size_t leaf_faces = 60000;
  // The geometric error of a tile above the leaves, as a part of its side. It grows while twice node_faces are left.
  double error = 1.0 / 200;
  // A tile above the leaves with more faces, besides one for each vertex that other tiles have too, gives up borders of
  // classes, the topology, and small pieces (SimplifyTiles3d). One with the colours of photographs has no fewer, if it
  // can, because its vertices are the picture's pixels.
  size_t node_faces = 16000;
  // By which each level above the sheets simplifies borders, as a part of a tile's side (tiles3d_border.h).
  double border_tolerance = 1.0 / 4000;
};

// Writes result/X_Y/tileset.json with its GLB files, the same in start/ if the start is given, and kPartFile with the
// coarsest meshes. Positions are east-north-up (GlobeMap). All errors of GlobeMap and of the disk.
StatusOr<std::vector<std::string>> WriteTiles3dSheet(const SheetInput& input, const std::string& folder,
                                                     const TaskControl& control);
StatusOr<std::vector<std::string>> WriteTiles3dSheet(const SheetInput& input, const std::string& folder,
                                                     const TaskControl& control, const Tiles3dSizes& sizes);

// Writes result/tileset.json, which places the sheets on the globe, and result/upper/ with the levels above the sheets;
// the same in start/ if sheets have it. Holds four coarsest meshes and the borders of their neighbours in memory.
StatusOr<std::vector<std::string>> JoinTiles3d(const JoinInput& input, const std::string& folder,
                                               const TaskControl& control);
StatusOr<std::vector<std::string>> JoinTiles3d(const JoinInput& input, const std::string& folder,
                                               const TaskControl& control, const Tiles3dSizes& sizes);

}  // namespace tessera
