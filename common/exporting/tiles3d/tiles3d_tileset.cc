#include "common/exporting/tiles3d/tiles3d_tileset.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/exporting/tiles3d/tiles3d_mesh.h"

namespace tessera {
namespace {

using TilesetObject = nlohmann::json;

// Centre and half axes.
TilesetObject TileBoxJson(const Eigen::AlignedBox3d& box) {
  const Eigen::Vector3d centre = box.center();
  const Eigen::Vector3d half = (box.sizes() / 2).cwiseMax(kTiles3dGrid_m);
  return {centre.x() + 0.0, centre.y() + 0.0, centre.z() + 0.0, half.x(), 0, 0, 0, half.y(), 0, 0, 0, half.z()};
}

TilesetObject TileJson(const Tiles3dTile& tile) {
  TilesetObject json = {{"boundingVolume", {{"box", TileBoxJson(tile.box)}}}, {"geometricError", tile.error_m}};
  if (!tile.uri.empty()) json["content"] = {{"uri", tile.uri}};
  if (tile.quarantined) json["extras"] = {{"quarantined", true}};
  for (const Tiles3dTile& child : tile.children) json["children"].push_back(TileJson(child));
  return json;
}

}  // namespace

std::string Tiles3dTilesetJson(const Tiles3dTile& root, const GlobeMap* globe) {
  TilesetObject json = {{"asset", {{"version", "1.1"}, {"extras", {{"generator", "Tessera"}}}}},
                        {"root", TileJson(root)}};
  // The error without the tile set: as large as what it shows.
  json["geometricError"] = std::max(root.error_m, root.box.diagonal().norm());
  json["root"]["refine"] = "REPLACE";
  if (root.quarantined) json["extras"] = {{"quarantined", true}};
  if (globe != nullptr && globe->on_globe()) {
    TilesetObject& transform = json["root"]["transform"];
    const Eigen::Matrix4d matrix = globe->ecef_from_enu().matrix();
    for (int k = 0; k < 16; ++k) transform.push_back(matrix(k % 4, k / 4) + 0.0);  // column by column
  } else if (globe != nullptr) {
    TilesetObject& extras = json["asset"]["extras"];
    extras["on_globe"] = false;
    extras["note"] = "The scene has no coordinate reference system: the tile set has no place on the globe.";
  }
  return json.dump(-1, ' ', false, TilesetObject::error_handler_t::replace) + "\n";
}

}  // namespace tessera
