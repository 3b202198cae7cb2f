#include "common/exporting/tiles3d/tiles3d_pieces.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "common/geometry/nearest_surface.h"

namespace tessera {
namespace {

// A piece with more faces is not small, unless it is below Tiles3dPieceLimits::size_m.
constexpr size_t kTilePieceFaces = 8;
constexpr uint32_t kNoTileFace = std::numeric_limits<uint32_t>::max();

TriangleMesh TilePieceSurface(const Tiles3dVertices& vertices, const Tiles3dFaces& faces) {
  TriangleMesh mesh;
  mesh.vertices = vertices.positions;
  mesh.faces = faces.corners;
  return mesh;
}

// Per face: a face that stands for its piece.
std::vector<uint32_t> TilePieces(const Tiles3dFaces& faces) {
  std::vector<uint32_t> piece(faces.size());
  std::iota(piece.begin(), piece.end(), 0);
  const auto piece_of = [&piece](uint32_t f) {
    while (piece[f] != f) f = piece[f] = piece[piece[f]];
    return f;
  };
  std::vector<std::array<uint32_t, 3>> edges;  // two vertices and the face
  edges.reserve(3 * faces.size());
  for (uint32_t f = 0; f < faces.size(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = faces.corners[f][k], b = faces.corners[f][(k + 1) % 3];
      edges.push_back({std::min(a, b), std::max(a, b), f});
    }
  }
  std::sort(edges.begin(), edges.end());
  for (size_t i = 1; i < edges.size(); ++i) {
    if (edges[i][0] == edges[i - 1][0] && edges[i][1] == edges[i - 1][1]) {
      piece[piece_of(edges[i][2])] = piece_of(edges[i - 1][2]);
    }
  }
  for (uint32_t f = 0; f < faces.size(); ++f) piece[f] = piece_of(f);
  return piece;
}

// Per face: 1 if a face before it has the same vertices, and not two of them are fixed.
std::vector<uint8_t> RepeatedTileFaces(const Tiles3dFaces& faces, const std::vector<uint8_t>& fixed) {
  std::vector<std::pair<Triangle, uint32_t>> sorted;
  sorted.reserve(faces.size());
  for (uint32_t f = 0; f < faces.size(); ++f) {
    Triangle face = faces.corners[f];
    std::sort(face.begin(), face.end());
    sorted.push_back({face, f});
  }
  std::sort(sorted.begin(), sorted.end());
  std::vector<uint8_t> repeated(faces.size(), 0);
  for (size_t i = 1; i < sorted.size(); ++i) {
    const Triangle& face = sorted[i].first;
    if (face == sorted[i - 1].first && fixed[face[0]] + fixed[face[1]] + fixed[face[2]] < 2) {
      repeated[sorted[i].second] = 1;
    }
  }
  return repeated;
}

enum class TilePieceFate : uint8_t { kStays, kNearOthers, kTooSmall };

}  // namespace

void MoveTiles3dPoints(const Tiles3dVertices& vertices, const Tiles3dFaces& faces, const std::vector<uint32_t>& source,
                       double near_m, std::vector<Tiles3dPoint>* points) {
  uint32_t most = 0;
  for (const Tiles3dPoint& point : *points) most = std::max(most, point.face + 1);
  std::vector<uint32_t> face_of(most, kNoTileFace);
  for (uint32_t f = 0; f < faces.size(); ++f) {
    if (source[f] < most) face_of[source[f]] = f;
  }
  const TriangleMesh mesh = TilePieceSurface(vertices, faces);
  std::optional<NearestSurface> surface;
  for (Tiles3dPoint& point : *points) {
    point.face = face_of[point.face];
    if (point.face != kNoTileFace) {
      const Eigen::Vector3d near = NearestPointOfTriangle(point.position, mesh.Corner(point.face, 0),
                                                          mesh.Corner(point.face, 1), mesh.Corner(point.face, 2));
      if ((near - point.position).norm() <= near_m) continue;
    }
    if (!surface) surface.emplace(mesh);
    point.face = static_cast<uint32_t>(surface->Find(point.position).face);
  }
}

Tiles3dFaces WithoutSmallTiles3dPieces(const Tiles3dVertices& vertices, const Tiles3dFaces& faces,
                                       const std::vector<uint8_t>& fixed, const Tiles3dPieceLimits& limits,
                                       std::vector<Tiles3dPoint>* points) {
  const std::vector<uint32_t> piece = TilePieces(faces);
  const std::vector<uint8_t> repeated = RepeatedTileFaces(faces, fixed);
  // By the face that stands for a piece.
  std::vector<size_t> sizes(faces.size(), 0);
  std::vector<uint8_t> is_fixed(faces.size(), 0);
  std::vector<Eigen::AlignedBox3d> boxes(faces.size());
  for (size_t f = 0; f < faces.size(); ++f) {
    const uint32_t p = piece[f];
    sizes[p] += repeated[f] ? 0 : 1;
    for (const uint32_t v : faces.corners[f]) {
      boxes[p].extend(vertices.positions[v]);
      if (fixed[v]) is_fixed[p] = 1;
    }
  }
  std::vector<TilePieceFate> fates(faces.size(), TilePieceFate::kStays);
  size_t largest = 0, left = 0;  // a piece, and faces
  double largest_m = -1;
  for (size_t p = 0; p < faces.size(); ++p) {
    if (piece[p] != p) continue;
    const double diagonal_m = boxes[p].diagonal().norm();
    if (diagonal_m > largest_m) {
      largest_m = diagonal_m;
      largest = p;
    }
    if (!is_fixed[p]) {
      if (diagonal_m < limits.size_m) {
        fates[p] = TilePieceFate::kTooSmall;
      } else if (sizes[p] <= kTilePieceFaces) {
        fates[p] = TilePieceFate::kNearOthers;
      }
    }
    left += fates[p] == TilePieceFate::kStays ? sizes[p] : 0;
  }
  if (left == 0) fates[largest] = TilePieceFate::kStays;
  const auto gather = [&](std::vector<uint32_t>* source) {
    Tiles3dFaces kept;
    for (uint32_t f = 0; f < faces.size(); ++f) {
      if (repeated[f] || fates[piece[f]] != TilePieceFate::kStays) continue;
      kept.Add(faces.corners[f], faces.labels[f]);
      source->push_back(f);
    }
    return kept;
  };
  // Small pieces that are far from the others stay.
  std::vector<uint32_t> source;
  {
    const TriangleMesh mesh = TilePieceSurface(vertices, gather(&source));
    const NearestSurface surface(mesh);
    const auto check = [&](uint32_t f, const Eigen::Vector3d& p) {
      TilePieceFate& fate = fates[piece[f]];
      if (fate == TilePieceFate::kNearOthers && surface.Find(p).distance_m > limits.distance_m) {
        fate = TilePieceFate::kStays;
      }
    };
    for (uint32_t f = 0; f < faces.size(); ++f) {
      for (const uint32_t v : faces.corners[f]) check(f, vertices.positions[v]);
    }
    for (const Tiles3dPoint& point : *points) check(point.face, point.position);
  }
  // The smallest go first.
  std::vector<std::pair<double, uint32_t>> small;
  size_t count = 0;
  for (uint32_t p = 0; p < faces.size(); ++p) {
    if (piece[p] != p) continue;
    count += sizes[p];
    if (fates[p] != TilePieceFate::kStays) small.push_back({boxes[p].diagonal().norm(), p});
  }
  std::sort(small.begin(), small.end());
  for (const auto& [diagonal_m, p] : small) {
    if (count <= limits.enough) {
      fates[p] = TilePieceFate::kStays;
    } else {
      count -= sizes[p];
    }
  }
  source.clear();
  Tiles3dFaces kept = gather(&source);
  if (kept.size() == faces.size()) return kept;
  std::erase_if(*points, [&](const Tiles3dPoint& p) { return fates[piece[p.face]] == TilePieceFate::kTooSmall; });
  std::vector<uint8_t> is_used(vertices.positions.size(), 0);
  for (const Triangle& face : kept.corners) {
    for (const uint32_t v : face) is_used[v] = 1;
  }
  for (uint32_t f = 0; f < faces.size(); ++f) {
    if (fates[piece[f]] != TilePieceFate::kNearOthers) continue;
    for (const uint32_t v : faces.corners[f]) {
      if (is_used[v]) continue;
      is_used[v] = 1;
      points->push_back({vertices.positions[v], f});
    }
  }
  MoveTiles3dPoints(vertices, kept, source, std::numeric_limits<double>::infinity(), points);
  return kept;
}

}  // namespace tessera
