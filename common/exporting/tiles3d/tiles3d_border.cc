#include "common/exporting/tiles3d/tiles3d_border.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <numeric>
#include <utility>

#include "common/base/random.h"
#include "common/geometry/position_index.h"

namespace tessera {
namespace {

// A face may turn so far (cosine) when a vertex of its border goes.
constexpr double kTiles3dTurn = 0.25;

bool ComesBefore(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::lexicographical_compare(a.begin(), a.end(), b.begin(), b.end());
}

double DistanceToSegment(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  const Eigen::Vector3d ab = b - a;
  const double t = ab.squaredNorm() > 0 ? std::clamp((p - a).dot(ab) / ab.squaredNorm(), 0.0, 1.0) : 0;
  return (p - a - t * ab).norm();
}

// Chains of border vertices between those where chains meet.
class BorderChains {
 public:
  // `is_end`: per vertex of the border.
  BorderChains(const std::vector<std::array<uint32_t, 2>>& edges, const std::vector<Eigen::Vector3d>& positions,
               const std::vector<uint8_t>& is_end)
      : edges_(edges), is_end_(is_end), used_(edges.size(), 0), edges_of_(positions.size()) {
    for (uint32_t e = 0; e < edges.size(); ++e) {
      for (const uint32_t v : edges[e]) edges_of_[v].push_back(e);
    }
    for (uint32_t e = 0; e < edges.size(); ++e) {
      for (const int k : {0, 1}) {
        if (is_end[edges[e][k]] && !used_[e]) Walk(edges[e][k], e);
      }
    }
    // Chains without an end begin with their lowest vertex, which both sides know.
    for (uint32_t e = 0; e < edges.size(); ++e) {
      if (used_[e]) continue;
      Walk(edges[e][0], e);
      std::vector<uint32_t>& loop = chains.back();
      loop.pop_back();
      const auto lowest = std::min_element(
          loop.begin(), loop.end(), [&](uint32_t a, uint32_t b) { return ComesBefore(positions[a], positions[b]); });
      std::rotate(loop.begin(), lowest, loop.end());
      loop.push_back(loop.front());
    }
  }

  std::vector<std::vector<uint32_t>> chains;  // closed ones end with their first vertex

 private:
  // Adds the chain that begins at vertex v with edge e.
  void Walk(uint32_t v, uint32_t e) {
    std::vector<uint32_t>& chain = chains.emplace_back();
    chain.push_back(v);
    while (true) {
      used_[e] = 1;
      v = edges_[e][edges_[e][0] == v ? 1 : 0];
      chain.push_back(v);
      if (is_end_[v]) return;
      const auto next = std::find_if(edges_of_[v].begin(), edges_of_[v].end(), [&](uint32_t n) { return !used_[n]; });
      if (next == edges_of_[v].end()) return;
      e = *next;
    }
  }

  const std::vector<std::array<uint32_t, 2>>& edges_;
  const std::vector<uint8_t>& is_end_;
  std::vector<uint8_t> used_;
  std::vector<std::vector<uint32_t>> edges_of_;
};

// Collapses border vertices into their neighbours on the border.
class BorderCollapser {
 public:
  BorderCollapser(const Tiles3dVertices& vertices, const Tiles3dFaces& faces)
      : positions_(vertices.positions),
        faces_(faces),
        faces_of_(positions_.size()),
        before_(positions_.size()),
        after_(positions_.size()),
        touched_(positions_.size(), 0) {
    for (uint32_t f = 0; f < faces.size(); ++f) {
      for (const uint32_t v : faces.corners[f]) faces_of_[v].push_back(f);
    }
  }

  // Marks the vertices between those of `chain` that stay, `kept`, for removal.
  void Add(const std::vector<uint32_t>& chain, const std::vector<size_t>& kept) {
    size_t next = 0;
    for (size_t i = 0; i < chain.size(); ++i) {
      if (kept[next] == i) {
        ++next;
        continue;
      }
      before_[chain[i]] = chain[i - 1];
      after_[chain[i]] = chain[i + 1];
      removed_.push_back(chain[i]);
    }
  }

  // Collapses a whole chain into one of its vertices.
  void Shrink(const std::vector<uint32_t>& chain, uint32_t target) {
    for (const uint32_t v : chain) {
      if (v != target) ReplaceCorners(v, target);
    }
  }

  // In rounds: each removes vertices that are not next to each other. What would turn a face over waits until the
  // neighbours are gone, and goes all the same when nothing else does, because the other side removes it too.
  // `source`: per face of the result, the face before.
  Tiles3dFaces Collapse(std::vector<uint32_t>* source) {
    for (bool forced = false; !removed_.empty();) {
      std::vector<uint32_t> left;
      std::fill(touched_.begin(), touched_.end(), 0);
      for (const uint32_t v : removed_) {
        if (!CollapseVertex(v, forced)) left.push_back(v);
      }
      forced = left.size() == removed_.size();
      removed_ = std::move(left);
    }
    Tiles3dFaces result;
    for (uint32_t f = 0; f < faces_.size(); ++f) {
      const Triangle& face = faces_.corners[f];
      const bool has_area = face[0] != face[1] && face[1] != face[2] && face[2] != face[0];
      if (!has_area) continue;
      result.Add(face, faces_.labels[f]);
      source->push_back(f);
    }
    return result;
  }

 private:
  bool CollapseVertex(uint32_t v, bool forced) {
    if (touched_[v]) return false;
    uint32_t near = before_[v], far = after_[v];
    if ((positions_[near] - positions_[v]).squaredNorm() > (positions_[far] - positions_[v]).squaredNorm()) {
      std::swap(near, far);
    }
    if (Fits(v, near) || (!Fits(v, far) && forced)) {
      CollapseInto(v, near);
    } else if (Fits(v, far)) {
      CollapseInto(v, far);
    } else {
      return false;
    }
    return true;
  }

  // Whether no face turns over if v goes to `target`.
  bool Fits(uint32_t v, uint32_t target) const {
    for (const uint32_t f : faces_of_[v]) {
      Triangle face = faces_.corners[f];
      if (std::find(face.begin(), face.end(), target) != face.end()) continue;
      const Eigen::Vector3d before = Cross(face);
      std::replace(face.begin(), face.end(), v, target);
      const Eigen::Vector3d after = Cross(face);
      const bool had_area = before.squaredNorm() > 0;
      if (had_area && before.dot(after) <= kTiles3dTurn * before.norm() * after.norm()) return false;
    }
    return true;
  }

  Eigen::Vector3d Cross(const Triangle& face) const {
    const Eigen::Vector3d& a = positions_[face[0]];
    return (positions_[face[1]] - a).cross(positions_[face[2]] - a);
  }

  void ReplaceCorners(uint32_t v, uint32_t target) {
    for (const uint32_t f : faces_of_[v]) {
      Triangle& face = faces_.corners[f];
      const bool has_target = std::find(face.begin(), face.end(), target) != face.end();
      std::replace(face.begin(), face.end(), v, target);
      if (!has_target) faces_of_[target].push_back(f);
    }
    faces_of_[v].clear();
  }

  void CollapseInto(uint32_t v, uint32_t target) {
    ReplaceCorners(v, target);
    const uint32_t before = before_[v], after = after_[v];
    after_[before] = after;
    before_[after] = before;
    touched_[before] = touched_[after] = 1;
  }

  const std::vector<Eigen::Vector3d>& positions_;
  Tiles3dFaces faces_;
  std::vector<std::vector<uint32_t>> faces_of_;  // also faces that have lost their area
  std::vector<uint32_t> before_, after_;         // on the chain, of vertices that are removed
  std::vector<uint8_t> touched_;                 // next to a vertex that this round removed
  std::vector<uint32_t> removed_;
};

}  // namespace

std::vector<std::array<uint32_t, 2>> Tiles3dSharedEdges(const Tiles3dVertices& vertices, const Tiles3dFaces& faces) {
  std::vector<std::array<uint32_t, 2>> edges;
  for (const Triangle& face : faces.corners) {
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = face[k], b = face[(k + 1) % 3];
      if (vertices.shared[a] && vertices.shared[b]) edges.push_back({std::min(a, b), std::max(a, b)});
    }
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
}

Tiles3dFaces ThinTiles3dBorder(const Tiles3dFaces& faces, const std::vector<std::vector<Tiles3dEdge>>& others,
                               double tolerance_m, double free_m, Tiles3dVertices* vertices,
                               std::vector<uint32_t>* source) {
  const std::vector<Eigen::Vector3d>& positions = vertices->positions;
  const std::vector<std::array<uint32_t, 2>> own = Tiles3dSharedEdges(*vertices, faces);
  // Edges of all tiles, by numbers of positions; those of this tile come first. `tiles`: a hash of the tiles that have
  // the edge.
  struct SharedEdge {
    std::array<uint32_t, 2> ends;
    uint64_t tiles = 0;
    int32_t count = 1;
  };
  PositionIndex places;
  std::vector<SharedEdge> all;
  const auto add = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b, size_t tile) {
    const uint32_t i = places.NumberOf(a), j = places.NumberOf(b);
    all.push_back({{std::min(i, j), std::max(i, j)}, MixBits(tile)});
  };
  std::vector<uint32_t> vertex_of_place;
  for (const auto& edge : own) {
    for (const uint32_t v : edge) {
      if (places.NumberOf(positions[v]) == vertex_of_place.size()) vertex_of_place.push_back(v);
    }
  }
  for (const auto& [a, b] : own) add(positions[a], positions[b], 0);
  for (size_t tile = 0; tile < others.size(); ++tile) {
    for (const Tiles3dEdge& edge : others[tile]) add(edge[0], edge[1], tile + 1);
  }
  std::sort(all.begin(), all.end(), [](const SharedEdge& a, const SharedEdge& b) { return a.ends < b.ends; });
  size_t size = 0;
  for (const SharedEdge& edge : all) {
    if (size > 0 && all[size - 1].ends == edge.ends) {
      all[size - 1].tiles += edge.tiles;
      ++all[size - 1].count;
    } else {
      all[size++] = edge;
    }
  }
  all.resize(size);
  std::erase_if(all, [](const SharedEdge& edge) { return edge.count < 2; });
  // A chain ends where not two edges meet, and where other tiles have the next edge.
  std::vector<int> degrees(places.positions().size(), 0);
  std::vector<uint64_t> tiles(degrees.size(), 0);
  std::vector<uint8_t> is_end_place(degrees.size(), 0);
  for (const SharedEdge& edge : all) {
    for (const uint32_t place : edge.ends) {
      if (++degrees[place] > 2 || (degrees[place] == 2 && tiles[place] != edge.tiles)) is_end_place[place] = 1;
      tiles[place] = edge.tiles;
    }
  }
  std::vector<uint8_t> is_end(positions.size(), 0), is_free(positions.size(), 0);
  for (size_t place = 0; place < vertex_of_place.size(); ++place) {
    is_free[vertex_of_place[place]] = degrees[place] == 1 ? 1 : 0;
    is_end[vertex_of_place[place]] = is_end_place[place] != 0 || degrees[place] == 1 ? 1 : 0;
  }
  std::vector<std::array<uint32_t, 2>> edges;
  for (const SharedEdge& edge : all) {
    if (edge.ends[1] >= vertex_of_place.size()) continue;
    const std::array<uint32_t, 2> ends = {vertex_of_place[edge.ends[0]], vertex_of_place[edge.ends[1]]};
    const std::array<uint32_t, 2> sorted = {std::min(ends[0], ends[1]), std::max(ends[0], ends[1])};
    if (std::binary_search(own.begin(), own.end(), sorted)) edges.push_back(sorted);
  }
  std::sort(edges.begin(), edges.end());
  std::fill(vertices->shared.begin(), vertices->shared.end(), 0);
  BorderCollapser collapser(*vertices, faces);
  for (const std::vector<uint32_t>& chain : BorderChains(edges, positions, is_end).chains) {
    std::vector<Eigen::Vector3d> points;
    for (const uint32_t v : chain) points.push_back(positions[v]);
    if (is_free[chain.front()] || is_free[chain.back()]) {
      uint32_t target = is_free[chain.front()] ? chain.back() : chain.front();
      const bool both = is_free[target] != 0;
      if (both && ComesBefore(positions[chain.front()], positions[target])) target = chain.front();
      const Eigen::Vector3d& at = positions[target];
      if (std::all_of(points.begin(), points.end(), [&](const auto& p) { return (p - at).norm() <= free_m; })) {
        collapser.Shrink(chain, target);
        if (!both) vertices->shared[target] = 1;
        continue;
      }
    }
    const std::vector<size_t> kept = SimplifyTiles3dChain(points, tolerance_m);
    collapser.Add(chain, kept);
    if (kept.size() == 2 && chain.front() == chain.back()) continue;  // it shrinks to a point
    for (const size_t i : kept) vertices->shared[chain[i]] = 1;
  }
  const Tiles3dFaces thinned = collapser.Collapse(source);
  if (thinned.size() > 0) return thinned;
  source->resize(faces.size());  // a tile has a face at least
  std::iota(source->begin(), source->end(), 0);
  return faces;
}

std::vector<size_t> SimplifyTiles3dChain(const std::vector<Eigen::Vector3d>& chain, double tolerance_m) {
  std::vector<Eigen::Vector3d> points = chain;
  const bool is_reversed =
      std::lexicographical_compare(chain.rbegin(), chain.rend(), chain.begin(), chain.end(), ComesBefore);
  if (is_reversed) std::reverse(points.begin(), points.end());
  std::vector<size_t> kept = {0, points.size() - 1};
  std::vector<std::pair<size_t, size_t>> parts = {{0, points.size() - 1}};
  while (!parts.empty()) {
    const auto [first, last] = parts.back();
    parts.pop_back();
    double largest_m = tolerance_m;
    size_t farthest = first;
    for (size_t i = first + 1; i < last; ++i) {
      const double distance_m = DistanceToSegment(points[i], points[first], points[last]);
      if (distance_m > largest_m) {
        largest_m = distance_m;
        farthest = i;
      }
    }
    if (farthest == first) continue;
    kept.push_back(farthest);
    parts.push_back({first, farthest});
    parts.push_back({farthest, last});
  }
  if (is_reversed) {
    for (size_t& i : kept) i = points.size() - 1 - i;
  }
  std::sort(kept.begin(), kept.end());
  return kept;
}

}  // namespace tessera
