#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/exporting/export_map.h"
#include "common/exporting/tiles3d/tiles3d.h"
#include "common/exporting/tiles3d/tiles3d_border.h"
#include "common/exporting/tiles3d/tiles3d_glb.h"
#include "common/exporting/tiles3d/tiles3d_part.h"
#include "common/exporting/tiles3d/tiles3d_tileset.h"
#include "common/exporting/tiles3d/tiles3d_upper.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

// Of the file beside that of a tile's mesh, with its border before it is thinned.
constexpr char kBorderEnding[] = ".border";

// A tile of the level that is being merged, with the file of its mesh.
struct UpperTile {
  SheetId id;  // in units of the level
  std::string part_path;
  Tiles3dTile tile;
  bool is_new = false;  // of this level; else an only child, which has been written
};

// Joins one set: pairs of columns and rows of sheets, then of those, up to one root.
class TileSetJoiner {
 public:
  TileSetJoiner(const JoinInput& input, std::string set, const std::string& folder, const std::string& scratch,
                const Tiles3dSizes& sizes)
      : input_(input), set_(std::move(set)), folder_(folder), scratch_(scratch), sizes_(sizes) {}

  Status Join(const GlobeMap& globe, const TaskControl& control, std::vector<std::string>* files) {
    std::vector<UpperTile> tiles;
    for (const JoinInput::Item& item : input_.sheets) {
      TESSERA_RETURN_IF_ERROR(control.Check());
      TESSERA_ASSIGN_OR_RETURN(const Tiles3dPart part, ReadTiles3dPart(item.part_path, set_));
      if (part.mesh.faces.size() == 0) continue;
      const std::string uri = SheetName(item.id) + "/tileset.json";
      tiles.push_back({item.id, item.part_path, {part.box, part.error_m, uri, item.set_aside, {}}});
    }
    if (tiles.empty()) return absl::OkStatus();
    for (int level = 1; tiles.size() > 1; ++level) {
      TESSERA_RETURN_IF_ERROR(JoinLevel(level, control, &tiles, files));
      control.Report(1 - 1.0 / (1.0 + level), absl::StrCat(set_, ", level ", level));
    }
    files->push_back(set_ + "/tileset.json");
    TESSERA_RETURN_IF_ERROR(EnsureFolder(absl::StrCat(folder_, "/", set_)));
    return WriteFileAtomic(absl::StrCat(folder_, "/", files->back()), Tiles3dTilesetJson(tiles[0].tile, &globe));
  }

 private:
  // Replaces the tiles by their parents. Halving never brings -1 and 0 together: the last four become one.
  Status JoinLevel(int level, const TaskControl& control, std::vector<UpperTile>* tiles,
                   std::vector<std::string>* files) {
    const bool last = std::all_of(tiles->begin(), tiles->end(), [](const UpperTile& t) {
      return t.id.x >= -1 && t.id.x <= 0 && t.id.y >= -1 && t.id.y <= 0;
    });
    std::map<SheetId, std::vector<UpperTile>> children;
    for (UpperTile& t : *tiles) {
      children[last ? SheetId{0, 0} : SheetId{t.id.x >> 1, t.id.y >> 1}].push_back(std::move(t));
    }
    tiles->clear();
    for (auto& [id, tiles_of_parent] : children) {
      TESSERA_RETURN_IF_ERROR(control.Check());
      TESSERA_ASSIGN_OR_RETURN(UpperTile parent, Merge(level, id, std::move(tiles_of_parent)));
      tiles->push_back(std::move(parent));
    }
    for (UpperTile& parent : *tiles) {
      TESSERA_RETURN_IF_ERROR(control.Check());
      TESSERA_RETURN_IF_ERROR(Simplify(level, *tiles, &parent, files));
    }
    return absl::OkStatus();
  }

  // Makes the parent with the merged mesh. An only child stays the tile: a parent would be the same again. Its mesh
  // goes on all the same, because its borders must be those of the level.
  StatusOr<UpperTile> Merge(int level, const SheetId& id, std::vector<UpperTile> children) const {
    const std::string name = absl::StrCat(level, "_", SheetName(id));
    UpperTile parent = {id, absl::StrCat(scratch_, "/", name), {}};
    std::vector<Tiles3dPart> parts;
    for (const UpperTile& child : children) {
      TESSERA_ASSIGN_OR_RETURN(Tiles3dPart read, ReadTiles3dPart(child.part_path, set_));
      parts.push_back(std::move(read));
    }
    const Tiles3dPart part = MergeTiles3dParts(std::move(parts));
    TESSERA_RETURN_IF_ERROR(WriteTiles3dParts(parent.part_path, {part}));
    TESSERA_RETURN_IF_ERROR(WriteTiles3dBorder(parent.part_path + kBorderEnding, part.mesh));
    if (children.size() == 1) {
      parent.tile = std::move(children[0].tile);
      return parent;
    }
    parent.is_new = true;
    parent.tile.uri = absl::StrCat("upper/", name, ".glb");
    parent.tile.box = part.box;
    for (UpperTile& child : children) {
      parent.tile.error_m = std::max(parent.tile.error_m, child.tile.error_m);
      parent.tile.children.push_back(std::move(child.tile));
    }
    return parent;
  }

  // Thins the border of the tile's mesh and simplifies it. `level_tiles`: all of the level, for their borders.
  Status Simplify(int level, const std::vector<UpperTile>& level_tiles, UpperTile* tile,
                  std::vector<std::string>* files) const {
    TESSERA_ASSIGN_OR_RETURN(Tiles3dPart part, ReadTiles3dPart(tile->part_path, set_));
    std::vector<std::vector<Tiles3dEdge>> borders;
    for (const UpperTile& other : level_tiles) {
      if (&other == tile || !other.tile.box.intersects(part.box)) continue;
      TESSERA_ASSIGN_OR_RETURN(std::vector<Tiles3dEdge> border, ReadTiles3dBorder(other.part_path + kBorderEnding));
      borders.push_back(std::move(border));
    }
    const double side_m = std::ldexp(kSheetCells * input_.scene.ground.cell_m, level);
    const bool photographic = input_.options.color == VertexColor::kImage && !part.mesh.vertices.colors.empty();
    const double error_m = SimplifyTiles3dPart(borders, side_m, tile->tile.error_m, photographic, sizes_, &part);
    if (tile->is_new) {
      tile->tile.error_m = error_m;
      files->push_back(absl::StrCat(set_, "/", tile->tile.uri));
      TESSERA_RETURN_IF_ERROR(EnsureFolder(absl::StrCat(folder_, "/", set_, "/upper")));
      TESSERA_RETURN_IF_ERROR(
          WriteFileAtomic(absl::StrCat(folder_, "/", files->back()),
                          MakeTiles3dGlb(part.mesh.vertices, part.mesh.faces, input_.scene.classes, photographic)));
    }
    return WriteTiles3dParts(tile->part_path, {part});
  }

  const JoinInput& input_;
  const std::string set_, folder_, scratch_;
  const Tiles3dSizes sizes_;
};

}  // namespace

StatusOr<std::vector<std::string>> JoinTiles3d(const JoinInput& input, const std::string& folder,
                                               const TaskControl& control) {
  return JoinTiles3d(input, folder, control, Tiles3dSizes());
}

StatusOr<std::vector<std::string>> JoinTiles3d(const JoinInput& input, const std::string& folder,
                                               const TaskControl& control, const Tiles3dSizes& sizes) {
  TESSERA_ASSIGN_OR_RETURN(const GlobeMap globe, GlobeMap::Open(input.scene));
  TESSERA_ASSIGN_OR_RETURN(const TempFolder scratch, TempFolder::Create(folder, "scratch-"));
  std::vector<std::string> files;
  TESSERA_RETURN_IF_ERROR(
      TileSetJoiner(input, "result", folder, scratch.path(), sizes).Join(globe, PartOf(control, 0, 0.5), &files));
  TESSERA_RETURN_IF_ERROR(
      TileSetJoiner(input, "start", folder, scratch.path(), sizes).Join(globe, PartOf(control, 0.5, 1), &files));
  return files;
}

}  // namespace tessera
