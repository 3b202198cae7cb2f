#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/exporting/color/vertex_colors.h"
#include "common/exporting/export_map.h"
#include "common/exporting/tiles3d/tiles3d.h"
#include "common/exporting/tiles3d/tiles3d_glb.h"
#include "common/exporting/tiles3d/tiles3d_part.h"
#include "common/exporting/tiles3d/tiles3d_simplify.h"
#include "common/exporting/tiles3d/tiles3d_tileset.h"
#include "common/exporting/tiles3d/tiles3d_upper.h"
#include "common/geometry/position_index.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

// Squares so many times halved are divided by the order of their faces: many faces have their centroids at one place.
constexpr int kTiles3dDepth = 24;
// About so many vertices of the finest mesh, besides those of the coarsest, measure the errors of the levels above.
constexpr size_t kTiles3dSamples = 50000;

struct TileNode {
  Tiles3dFaces faces;                // of its content
  std::vector<Tiles3dPoint> points;  // vertices of the leaves below that `faces` lack
  std::vector<int> children;         // empty: a leaf
  int parent = -1;                   // -1: the root
  int height = 0;                    // above the leaves
  double side_m = 0;                 // of its square
  double error_m = 0;
  Eigen::AlignedBox3d box;
};

// The quadtree over a sheet. Children come before their parents, the root is last.
class TileTree {
 public:
  // `corners`: of the sheet's faces.
  TileTree(const Sheet& sheet, const std::vector<Triangle>& corners, const GroundPlane& ground, const SheetId& id,
           size_t leaf_faces)
      : sheet_(sheet), corners_(corners), leaf_faces_(leaf_faces) {
    const CellRect cells = CellsOf(id);
    const Eigen::Vector2d low = Eigen::Vector2d(cells.x0, cells.y0) * ground.cell_m;
    std::vector<uint32_t> faces(corners.size());
    for (uint32_t f = 0; f < faces.size(); ++f) {
      faces[f] = f;
      centroids_.push_back(ground.Coordinates(sheet.mesh().Centroid(f)));
    }
    const double half_m = kSheetCells * ground.cell_m / 2;
    if (!faces.empty()) Add(faces, low.array() + half_m, half_m / 2, 0);
    for (int i = 0; i < static_cast<int>(nodes.size()); ++i) {
      for (const int child : nodes[i].children) nodes[child].parent = i;
    }
  }

  // Per vertex: the lowest node that has all of its faces.
  std::vector<int> NodesOfVertices() const {
    std::vector<int> common(sheet_.vertices.size(), -1);
    for (int i = 0; i < static_cast<int>(nodes.size()); ++i) {
      for (const Triangle& face : nodes[i].faces.corners) {
        for (const uint32_t v : face) common[v] = common[v] < 0 ? i : Common(common[v], i);
      }
    }
    return common;
  }

  std::vector<TileNode> nodes;

 private:
  // Of two nodes. A parent has a higher index than its children.
  int Common(int a, int b) const {
    while (a != b) {
      int& low = a < b ? a : b;
      low = nodes[low].parent;
    }
    return a;
  }

  // Adds the node of `faces` in the square around `centre`; returns its index. `quarter_m`: a quarter of its side.
  int Add(std::span<uint32_t> faces, const Eigen::Vector2d& centre, double quarter_m, int depth) {
    TileNode node;
    node.side_m = 4 * quarter_m;
    if (faces.size() <= leaf_faces_) {
      for (const uint32_t f : faces) node.faces.Add(corners_[f], sheet_.labels[f]);
    } else {
      std::array<std::vector<uint32_t>, 4> quadrants;
      for (size_t i = 0; i < faces.size(); ++i) {
        const Eigen::Vector2d& p = centroids_[faces[i]];
        const size_t quadrant = depth >= kTiles3dDepth ? 4 * i / faces.size()
                                                       : (p.x() >= centre.x() ? 1 : 0) + (p.y() >= centre.y() ? 2 : 0);
        quadrants[quadrant].push_back(faces[i]);
      }
      for (int q = 0; q < 4; ++q) {
        if (quadrants[q].empty()) continue;
        const Eigen::Vector2d shift(q % 2 == 1 ? quarter_m : -quarter_m, q / 2 == 1 ? quarter_m : -quarter_m);
        node.children.push_back(Add(quadrants[q], centre + shift, quarter_m / 2, depth + 1));
      }
      if (node.children.size() == 1) return node.children[0];
      for (const int child : node.children) node.height = std::max(node.height, nodes[child].height + 1);
    }
    nodes.push_back(std::move(node));
    return static_cast<int>(nodes.size()) - 1;
  }

  const Sheet& sheet_;
  const std::vector<Triangle>& corners_;
  const size_t leaf_faces_;
  std::vector<Eigen::Vector2d> centroids_;
};

// One vertex a position for the corners on the border; sets vertices->shared.
void WeldTileBorder(const Sheet& sheet, std::vector<Triangle>* corners, Tiles3dVertices* vertices) {
  const size_t count = vertices->positions.size();
  Tiles3dFaces faces;
  faces.corners.swap(*corners);
  const std::vector<uint8_t> border = Tiles3dBorder(faces, count);
  vertices->shared = sheet.shared.empty() ? border : sheet.shared;
  PositionIndex positions;
  std::vector<uint32_t> first, welded(count);
  for (uint32_t v = 0; v < count; ++v) {
    welded[v] = v;
    if (!border[v]) continue;
    const uint32_t number = positions.NumberOf(vertices->positions[v]);
    if (number == first.size()) first.push_back(v);
    welded[v] = first[number];
    vertices->shared[welded[v]] |= vertices->shared[v];
  }
  corners->swap(faces.corners);
  for (Triangle& face : *corners) {
    const Triangle out = {welded[face[0]], welded[face[1]], welded[face[2]]};
    if (out[0] != out[1] && out[1] != out[2] && out[2] != out[0]) face = out;
  }
}

// Vertices of the sheet with the flag of those that other sheets may have. Replaces corners of the faces on the border
// so that they have one vertex a position.
StatusOr<Tiles3dVertices> TileVerticesOf(const Sheet& sheet, const SheetInput& input, const GlobeMap& globe,
                                         std::vector<Triangle>* corners) {
  Tiles3dVertices vertices;
  vertices.positions = sheet.vertices;
  TESSERA_RETURN_IF_ERROR(globe.EnuFromLocal(vertices.positions));
  for (Eigen::Vector3d& p : vertices.positions) {
    p = (p / kTiles3dGrid_m).array().round() * kTiles3dGrid_m + 0.0;  // + 0.0: no -0
  }
  vertices.displacement_m = sheet.displacement_m;
  WeldTileBorder(sheet, corners, &vertices);
  // Means of the faces around a vertex, by area.
  vertices.normals.assign(sheet.vertices.size(), Eigen::Vector3f::Zero());
  std::vector<float> areas(sheet.confidence.empty() ? 0 : sheet.vertices.size(), 0);
  vertices.confidence.assign(areas.size(), 0);
  for (size_t f = 0; f < corners->size(); ++f) {
    const Triangle& face = (*corners)[f];
    const Eigen::Vector3d& a = vertices.positions[face[0]];
    const Eigen::Vector3f cross =
        (vertices.positions[face[1]] - a).cross(vertices.positions[face[2]] - a).cast<float>();
    const float area = sheet.confidence.empty() ? 0 : cross.norm();
    for (const uint32_t v : face) {
      vertices.normals[v] += cross;
      if (sheet.confidence.empty()) continue;
      areas[v] += area;
      vertices.confidence[v] += area * sheet.confidence[f];
    }
  }
  for (Eigen::Vector3f& n : vertices.normals) n.stableNormalize();
  for (size_t v = 0; v < areas.size(); ++v) vertices.confidence[v] /= std::max(areas[v], 1e-20f);
  // The start lacks these values: it has the colours of classes.
  const VertexColor color = input.options.color;
  const bool is_known = (color == VertexColor::kImage && !sheet.colors.empty()) ||
                        (color == VertexColor::kConfidence && !sheet.confidence.empty()) ||
                        (color == VertexColor::kDisplacement && !sheet.displacement_m.empty());
  if (is_known) vertices.colors = VertexColors(sheet, input.scene, color);
  return vertices;
}

Tiles3dTile TileOf(const std::vector<TileNode>& nodes, int index) {
  Tiles3dTile tile;
  tile.box = nodes[index].box;
  tile.error_m = nodes[index].error_m;
  tile.uri = absl::StrCat(index, ".glb");
  for (const int child : nodes[index].children) tile.children.push_back(TileOf(nodes, child));
  return tile;
}

// Writes the tiles of one set.
class TileSetWriter {
 public:
  TileSetWriter(const SheetInput& input, const Sheet& sheet, std::string set, const std::string& folder,
                const Tiles3dSizes& sizes)
      : input_(input), sheet_(sheet), set_(std::move(set)), folder_(folder), sizes_(sizes) {}

  StatusOr<Tiles3dPart> Write(const GlobeMap& globe, const TaskControl& control, std::vector<std::string>* files) {
    Tiles3dPart part;
    part.set = set_;
    if (sheet_.faces.empty()) return part;
    std::vector<Triangle> corners = sheet_.faces;
    TESSERA_ASSIGN_OR_RETURN(vertices_, TileVerticesOf(sheet_, input_, globe, &corners));
    TileTree tree(sheet_, corners, input_.scene.ground, input_.id, sizes_.leaf_faces);
    node_of_vertex_ = tree.NodesOfVertices();
    std::vector<TileNode> nodes = std::move(tree.nodes);
    const std::string subfolder = absl::StrCat(set_, "/", SheetName(input_.id));
    TESSERA_RETURN_IF_ERROR(EnsureFolder(absl::StrCat(folder_, "/", subfolder)));
    std::vector<Status> results(nodes.size());
    for (int height = 0; height <= nodes.back().height; ++height) {
      TESSERA_RETURN_IF_ERROR(control.Check());
      ParallelForEach(nodes.size(), 1, [&](size_t i) {
        if (nodes[i].height != height) return;
        const std::string name = absl::StrCat(subfolder, "/", i, ".glb");
        results[i] = WriteFileAtomic(absl::StrCat(folder_, "/", name), Content(i, &nodes));
      });
      for (const Status& result : results) TESSERA_RETURN_IF_ERROR(result);
      control.Report((height + 1.0) / (nodes.back().height + 1.0), set_);
    }
    for (size_t i = 0; i < nodes.size(); ++i) files->push_back(absl::StrCat(subfolder, "/", i, ".glb"));
    Tiles3dTile root = TileOf(nodes, static_cast<int>(nodes.size()) - 1);
    root.quarantined = input_.set_aside;
    files->push_back(subfolder + "/tileset.json");
    TESSERA_RETURN_IF_ERROR(
        WriteFileAtomic(absl::StrCat(folder_, "/", files->back()), Tiles3dTilesetJson(root, nullptr)));
    part.mesh = CompactTiles3d(vertices_, nodes.back().faces);
    part.box = root.box;
    part.error_m = root.error_m;
    const std::vector<Tiles3dPoint>& points = nodes.back().points;
    const size_t step = points.size() / kTiles3dSamples + 1;
    for (size_t i = 0; i < points.size(); i += step) part.samples.push_back(points[i]);
    part.samples_error_m = root.error_m;
    return part;
  }

 private:
  // Completes the node; its children are complete. Returns its GLB file.
  std::string Content(size_t index, std::vector<TileNode>* nodes) const {
    TileNode& node = (*nodes)[index];
    Tiles3dFaces fine = std::move(node.faces);
    std::vector<Tiles3dPoint> points;
    for (const int child : node.children) {
      TileNode& c = (*nodes)[child];
      for (Tiles3dPoint& point : c.points) {
        point.face += static_cast<uint32_t>(fine.size());
        points.push_back(point);
      }
      fine.Append(c.faces);
      c.faces = {};
      c.points = {};
      node.box.extend(c.box);
      node.error_m = std::max(node.error_m, c.error_m);
    }
    const Tiles3dMesh mesh = CompactTiles3d(vertices_, fine);
    for (const Eigen::Vector3d& p : mesh.vertices.positions) node.box.extend(p);
    const bool photographic = input_.options.color == VertexColor::kImage && !mesh.vertices.colors.empty();
    Tiles3dFaces faces;
    if (node.children.empty()) {
      faces = mesh.faces;
    } else {
      const Tiles3dTarget target = Tiles3dTargetOf(sizes_, node.side_m, photographic);
      std::vector<uint8_t> fixed;
      for (const uint32_t v : mesh.vertex_of) {
        fixed.push_back(vertices_.shared[v] != 0 || node_of_vertex_[v] > static_cast<int>(index) ? 1 : 0);
      }
      Tiles3dLevel level = SimplifyTiles3d(mesh.vertices, mesh.faces, target, fixed, points);
      faces = std::move(level.faces);
      node.points = std::move(level.points);
      // The parent's error is larger, also where nothing was simplified.
      node.error_m = std::max(level.distance_m, node.error_m + kTiles3dGrid_m);
    }
    for (size_t f = 0; f < faces.size(); ++f) {
      const Triangle& face = faces.corners[f];
      node.faces.Add({mesh.vertex_of[face[0]], mesh.vertex_of[face[1]], mesh.vertex_of[face[2]]}, faces.labels[f]);
    }
    return MakeTiles3dGlb(mesh.vertices, faces, input_.scene.classes, photographic);
  }

  const SheetInput& input_;
  const Sheet& sheet_;
  const std::string set_;
  const std::string folder_;
  const Tiles3dSizes sizes_;
  Tiles3dVertices vertices_;
  std::vector<int> node_of_vertex_;  // the lowest node that has all faces of the vertex
};

}  // namespace

StatusOr<std::vector<std::string>> WriteTiles3dSheet(const SheetInput& input, const std::string& folder,
                                                     const TaskControl& control) {
  return WriteTiles3dSheet(input, folder, control, Tiles3dSizes());
}

StatusOr<std::vector<std::string>> WriteTiles3dSheet(const SheetInput& input, const std::string& folder,
                                                     const TaskControl& control, const Tiles3dSizes& sizes) {
  TESSERA_ASSIGN_OR_RETURN(const GlobeMap globe, GlobeMap::Open(input.scene));
  std::vector<std::string> files;
  std::vector<Tiles3dPart> parts;
  const double half = input.start ? 0.5 : 1.0;
  TESSERA_ASSIGN_OR_RETURN(
      Tiles3dPart result,
      TileSetWriter(input, input.sheet, "result", folder, sizes).Write(globe, PartOf(control, 0, half), &files));
  parts.push_back(std::move(result));
  if (input.start) {
    TESSERA_ASSIGN_OR_RETURN(
        Tiles3dPart start,
        TileSetWriter(input, *input.start, "start", folder, sizes).Write(globe, PartOf(control, half, 1), &files));
    parts.push_back(std::move(start));
  }
  TESSERA_RETURN_IF_ERROR(WriteTiles3dParts(absl::StrCat(folder, "/", kPartFile), parts));
  return files;
}

}  // namespace tessera
