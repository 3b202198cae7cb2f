// tileset.json of 3D Tiles 1.1.
#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/exporting/export_map.h"

namespace tessera {

struct Tiles3dTile {
  Eigen::AlignedBox3d box;   // of its content and its children, east-north-up
  double error_m = 0;        // largest distance of a vertex of the finest mesh to the content; 0: it is the finest
  std::string uri;           // of the content, relative to tileset.json: a GLB file or the tileset of a sheet
  bool quarantined = false;  // some of its faces are of tiles whose refinement failed
  std::vector<Tiles3dTile> children;
};

// JSON of the tile set with this root; children replace their parent. With `globe`, the root gets the transform to
// earth-centred coordinates; without a place on the globe, the file says so.
std::string Tiles3dTilesetJson(const Tiles3dTile& root, const GlobeMap* globe);

}  // namespace tessera
