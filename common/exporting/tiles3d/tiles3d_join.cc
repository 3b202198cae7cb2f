#include <algorithm>
#include <map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/exporting/export_map.h"
#include "common/exporting/tiles3d/tiles3d.h"
#include "common/exporting/tiles3d/tiles3d_glb.h"
#include "common/exporting/tiles3d/tiles3d_part.h"
#include "common/exporting/tiles3d/tiles3d_tileset.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

// With more samples, the vertices of the level below take their place: memory and time stay bounded, and the error adds
// up less often than at every level.
constexpr size_t kTileSamples = 500000;

// A tile of the level that is being merged, with the file of its mesh.
struct UpperTile {
  SheetId id;  // in units of the level
  std::string part_path;
  Tiles3dTile tile;
};

// Joins one set: pairs of columns and rows of sheets, then of those, up to one root.
class TileSetJoiner {
 public:
  TileSetJoiner(const JoinInput& input, std::string set, const std::string& folder, const std::string& scratch,
                size_t node_faces)
      : input_(input), set_(std::move(set)), folder_(folder), scratch_(scratch), node_faces_(node_faces) {}

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
    std::map<SheetId, std::vector<UpperTile>> parents;
    for (UpperTile& t : *tiles) {
      const SheetId id = last ? SheetId{0, 0} : SheetId{t.id.x >> 1, t.id.y >> 1};
      parents[id].push_back(std::move(t));
    }
    tiles->clear();
    for (auto& [id, children] : parents) {
      TESSERA_RETURN_IF_ERROR(control.Check());
      if (children.size() == 1) {  // a parent would be the same tile again
        tiles->push_back(std::move(children[0]));
        tiles->back().id = id;
        continue;
      }
      TESSERA_ASSIGN_OR_RETURN(UpperTile parent, Merge(level, id, std::move(children), files));
      tiles->push_back(std::move(parent));
    }
    return absl::OkStatus();
  }

  StatusOr<UpperTile> Merge(int level, const SheetId& id, std::vector<UpperTile> children,
                            std::vector<std::string>* files) {
    const std::string name = absl::StrCat(level, "_", SheetName(id));
    UpperTile parent = {id, absl::StrCat(scratch_, "/", name), {}};
    parent.tile.uri = absl::StrCat("upper/", name, ".glb");
    std::vector<Tiles3dMesh> meshes;
    Tiles3dPart part;
    part.set = set_;
    for (UpperTile& child : children) {
      TESSERA_ASSIGN_OR_RETURN(Tiles3dPart read, ReadTiles3dPart(child.part_path, set_));
      meshes.push_back(std::move(read.mesh));
      part.samples.insert(part.samples.end(), read.samples.begin(), read.samples.end());
      part.samples_error_m = std::max(part.samples_error_m, read.samples_error_m);
      parent.tile.box.extend(child.tile.box);
      parent.tile.error_m = std::max(parent.tile.error_m, child.tile.error_m);
      parent.tile.children.push_back(std::move(child.tile));
    }
    part.mesh = MergeTiles3d(meshes);
    const Tiles3dVertices& vertices = part.mesh.vertices;
    const Tiles3dFaces faces = SimplifyTiles3d(vertices, part.mesh.faces, node_faces_);
    if (part.samples.size() > kTileSamples) {
      part.samples = vertices.positions;
      part.samples_error_m = parent.tile.error_m;
    }
    // The parent's error is larger, also where nothing was simplified.
    parent.tile.error_m = std::max(part.samples_error_m + Tiles3dDistance(part.samples, vertices, faces),
                                   parent.tile.error_m + kTiles3dGrid_m);
    const bool photographic = input_.options.color == VertexColor::kImage && !vertices.colors.empty();
    files->push_back(absl::StrCat(set_, "/", parent.tile.uri));
    TESSERA_RETURN_IF_ERROR(EnsureFolder(absl::StrCat(folder_, "/", set_, "/upper")));
    TESSERA_RETURN_IF_ERROR(WriteFileAtomic(absl::StrCat(folder_, "/", files->back()),
                                            MakeTiles3dGlb(vertices, faces, input_.scene.classes, photographic)));
    part.mesh = CompactTiles3d(vertices, faces);
    part.box = parent.tile.box;
    part.error_m = parent.tile.error_m;
    TESSERA_RETURN_IF_ERROR(WriteTiles3dParts(parent.part_path, {part}));
    return parent;
  }

  const JoinInput& input_;
  const std::string set_, folder_, scratch_;
  const size_t node_faces_;
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
  TESSERA_RETURN_IF_ERROR(TileSetJoiner(input, "result", folder, scratch.path(), sizes.node_faces)
                              .Join(globe, PartOf(control, 0, 0.5), &files));
  TESSERA_RETURN_IF_ERROR(TileSetJoiner(input, "start", folder, scratch.path(), sizes.node_faces)
                              .Join(globe, PartOf(control, 0.5, 1), &files));
  return files;
}

}  // namespace tessera
