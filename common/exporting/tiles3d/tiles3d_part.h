// The coarsest mesh of a sheet, from which the levels above are made.
#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/exporting/tiles3d/tiles3d_border.h"
#include "common/exporting/tiles3d/tiles3d_mesh.h"

namespace tessera {

struct Tiles3dPart {
  std::string set;  // "result" or "start"
  Tiles3dMesh mesh;
  Eigen::AlignedBox3d box;  // of all levels
  double error_m = 0;       // largest distance of the finest mesh to `mesh`
  // Points by which levels above measure their distance, besides the vertices of `mesh`: vertices of the sheets'
  // coarsest meshes and some of the finest; and the largest distance of the finest mesh to the sheets' coarsest.
  std::vector<Tiles3dPoint> samples;
  double samples_error_m = 0;
};

// An array file; parts without faces are left out.
Status WriteTiles3dParts(const std::string& path, const std::vector<Tiles3dPart>& parts);
// The part `set` of the file; without faces if the file has none. DATA_LOSS if the file is damaged.
StatusOr<Tiles3dPart> ReadTiles3dPart(const std::string& path, const std::string& set);

// The positions of the ends of Tiles3dSharedEdges.
Status WriteTiles3dBorder(const std::string& path, const Tiles3dMesh& mesh);
StatusOr<std::vector<Tiles3dEdge>> ReadTiles3dBorder(const std::string& path);

// One mesh of several: vertices at equal positions on the borders become one. Adds to `source` the face before of each
// face; faces of the meshes have numbers one after the other.
Tiles3dMesh MergeTiles3d(const std::vector<Tiles3dMesh>& meshes, std::vector<uint32_t>* source);

}  // namespace tessera
