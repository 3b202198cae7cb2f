#include "common/exporting/tiles3d/tiles3d_simplify.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <queue>
#include <utility>
#include <vector>

#include "common/exporting/tiles3d/tiles3d_pieces.h"
#include "common/geometry/nearest_surface.h"

namespace tessera {
namespace {

constexpr uint32_t kNoCollapse = std::numeric_limits<uint32_t>::max();
// A face may turn so far (cosine) in one collapse.
constexpr double kCollapseTurn = 0.25;
// Weight of the squared length of an edge beside its quadric error. Where errors are equal, short edges go first, and
// no edge longer than 32 times the allowed distance goes.
constexpr double kCollapseLength = 1.0 / 1024;
// Faces around a vertex at most: more make thin faces and slow checks.
constexpr size_t kCollapseValence = 40;
// By which the distance grows while too many faces are left.
constexpr double kCollapseGrowth = 1.4142135623730951;
constexpr int kCollapseSteps = 16;
// Pieces whose box has a diagonal below this part of the distance may be left out.
constexpr double kCollapsePiece = 0.5;
// The same while too many faces are left: the distance cannot be kept otherwise.
constexpr double kCollapseLargestPiece = 8;
// How often small pieces are left out before the distance grows.
constexpr int kCollapseRounds = 3;
// A face that is nearer than this part of the allowed squared distance need not be the nearest.
constexpr double kCollapseNear = 1.0 / 16;
// Weight of the quadrics of borders of classes.
constexpr double kCollapseSeam = 2;

// Weighted mean of squared distances to planes.
struct PlaneQuadric {
  Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  double c = 0, weight = 0;

  void AddPlane(const Eigen::Vector3d& normal, const Eigen::Vector3d& point, double w) {
    const double d = -normal.dot(point);
    a += w * normal * normal.transpose();
    b += w * d * normal;
    c += w * d * d;
    weight += w;
  }
  void Add(const PlaneQuadric& other) {
    a += other.a;
    b += other.b;
    c += other.c;
    weight += other.weight;
  }
  double Error(const Eigen::Vector3d& p) const {
    return weight > 0 ? std::max(0.0, (p.dot(a * p) + 2 * b.dot(p) + c) / weight) : 0;
  }
};

// A neighbour of a vertex.
struct RingVertex {
  uint32_t vertex = 0;
  int32_t label = 0;     // of the first face on their edge
  bool is_seam = false;  // the faces on their edge are of different classes
  int faces = 1;         // on their edge
};

class TileCollapser {
 public:
  TileCollapser(const Tiles3dVertices& vertices, const Tiles3dFaces& faces, const std::vector<Tiles3dPoint>& points,
                std::vector<uint8_t> fixed)
      : faces_(faces.corners),
        labels_(faces.labels),
        left_(faces.size()),
        is_alive_(faces.size(), 1),
        is_fixed_(std::move(fixed)),
        first_point_(faces.size(), kNoCollapse) {
    const size_t count = vertices.positions.size();
    Eigen::AlignedBox3d box;
    for (const Eigen::Vector3d& p : vertices.positions) box.extend(p);
    positions_.reserve(count);
    centre_ = box.center();
    for (const Eigen::Vector3d& p : vertices.positions) positions_.push_back(p - centre_);
    points_ = positions_;
    next_point_.assign(count + points.size(), kNoCollapse);
    for (const Tiles3dPoint& point : points) {
      next_point_[points_.size()] = first_point_[point.face];
      first_point_[point.face] = static_cast<uint32_t>(points_.size());
      points_.push_back(point.position - centre_);
    }
    quadrics_.resize(count);
    faces_of_.resize(count);
    state_.assign(count, State::kIdle);
    marks_.assign(count, 0);
    std::vector<uint32_t> valence(count, 0);
    for (const Triangle& face : faces_) {
      for (const uint32_t v : face) ++valence[v];
    }
    for (size_t v = 0; v < count; ++v) faces_of_[v].reserve(valence[v] + 2);
    for (uint32_t f = 0; f < faces_.size(); ++f) {
      for (const uint32_t v : faces_[f]) faces_of_[v].push_back(f);
    }
    AddPlaneQuadrics();
    AddSeamQuadrics();
  }

  // Collapses what the distance permits, until `enough` faces are left.
  void Collapse(double distance_m, size_t enough) {
    squared_ = distance_m * distance_m;
    for (uint32_t v = 0; v < positions_.size(); ++v) {
      if (!is_fixed_[v] && !faces_of_[v].empty()) Push(v);
    }
    while (!queue_.empty() && left_ > enough) {
      const auto [key, v] = queue_.top();
      queue_.pop();
      state_[v] = State::kIdle;
      if (faces_of_[v].empty()) continue;
      FindTargets(v);
      if (targets_.empty()) continue;
      if (targets_[0].first > key && !queue_.empty() && targets_[0].first > queue_.top().first) {
        state_[v] = State::kQueued;
        queue_.push({targets_[0].first, v});
        continue;
      }
      TryTargets(v);
    }
    queue_ = {};
    std::fill(state_.begin(), state_.end(), State::kIdle);
  }

  // From now on, neither borders of classes nor the topology are kept.
  void KeepDistancesOnly() {
    keeps_all_ = false;
    std::fill(quadrics_.begin(), quadrics_.end(), PlaneQuadric());
    AddPlaneQuadrics();
  }
  // From now on, faces may turn over: tiles show both sides.
  void AllowTurns() { keeps_turn_ = false; }
  size_t left() const { return left_; }

  Tiles3dLevel Level() const {
    Tiles3dLevel level;
    for (size_t f = 0; f < faces_.size(); ++f) {
      if (!is_alive_[f]) continue;
      for (uint32_t p = first_point_[f]; p != kNoCollapse; p = next_point_[p]) {
        level.distance_m = std::max(level.distance_m, std::sqrt(SquaredDistance(p, faces_[f])));
        level.points.push_back({points_[p] + centre_, static_cast<uint32_t>(level.faces.size())});
      }
      level.faces.Add(faces_[f], labels_[f]);
    }
    return level;
  }

 private:
  enum class State : uint8_t { kIdle, kQueued };
  using Entry = std::pair<double, uint32_t>;
  static constexpr size_t kTries = 3;

  Eigen::Vector3d Cross(const Triangle& face) const {
    const Eigen::Vector3d& a = positions_[face[0]];
    return (positions_[face[1]] - a).cross(positions_[face[2]] - a);
  }

  double SquaredDistance(uint32_t point, const Triangle& face) const {
    const Eigen::Vector3d& p = points_[point];
    return (NearestPointOfTriangle(p, positions_[face[0]], positions_[face[1]], positions_[face[2]]) - p).squaredNorm();
  }

  // Planes of the faces that are left.
  void AddPlaneQuadrics() {
    for (size_t f = 0; f < faces_.size(); ++f) {
      if (!is_alive_[f]) continue;
      const Eigen::Vector3d cross = Cross(faces_[f]);
      const double area = cross.norm();
      if (!(area > 0)) continue;
      PlaneQuadric quadric;
      quadric.AddPlane(cross / area, positions_[faces_[f][0]], area);
      for (const uint32_t v : faces_[f]) quadrics_[v].Add(quadric);
    }
  }

  // Planes through the borders of classes, upright on the faces there: vertices of them leave them late.
  void AddSeamQuadrics() {
    for (uint32_t v = 0; v < positions_.size(); ++v) {
      FindRing(v);
      for (const RingVertex& n : ring_) {
        if (!n.is_seam || n.vertex < v || (is_fixed_[v] && is_fixed_[n.vertex])) continue;
        const Eigen::Vector3d edge = positions_[n.vertex] - positions_[v];
        for (const uint32_t f : faces_of_[v]) {
          const Triangle& face = faces_[f];
          if (std::find(face.begin(), face.end(), n.vertex) == face.end()) continue;
          const Eigen::Vector3d normal = edge.cross(Cross(face));
          if (!(normal.squaredNorm() > 0)) continue;
          PlaneQuadric quadric;
          quadric.AddPlane(normal.normalized(), positions_[v], kCollapseSeam * edge.squaredNorm());
          quadrics_[v].Add(quadric);
          quadrics_[n.vertex].Add(quadric);
        }
      }
    }
  }

  // Fills ring_; returns the number of its seam edges.
  int FindRing(uint32_t v) {
    ring_.clear();
    for (const uint32_t f : faces_of_[v]) {
      for (const uint32_t n : faces_[f]) {
        if (n == v) continue;
        auto it = std::find_if(ring_.begin(), ring_.end(), [n](const RingVertex& r) { return r.vertex == n; });
        if (it == ring_.end()) {
          ring_.push_back({n, labels_[f]});
        } else {
          it->is_seam = it->is_seam || it->label != labels_[f];
          ++it->faces;
        }
      }
    }
    for (RingVertex& r : ring_) r.is_seam = r.is_seam || r.faces != 2;
    return static_cast<int>(std::count_if(ring_.begin(), ring_.end(), [](const RingVertex& r) { return r.is_seam; }));
  }

  // Fills targets_ with the neighbours that v may go to, best first.
  void FindTargets(uint32_t v) {
    targets_.clear();
    int seams = FindRing(v);
    if (!keeps_all_) seams = 0;
    if (seams != 0 && seams != 2) return;
    for (const RingVertex& n : ring_) {
      if (seams == 2 && !n.is_seam) continue;
      const Eigen::Vector3d& p = positions_[n.vertex];
      targets_.push_back({quadrics_[v].Error(p) + kCollapseLength * (p - positions_[v]).squaredNorm(), n.vertex});
    }
    const size_t best = std::min(kTries, targets_.size());
    std::partial_sort(targets_.begin(), targets_.begin() + static_cast<std::ptrdiff_t>(best), targets_.end());
    targets_.resize(best);
  }

  void Push(uint32_t v) {
    if (state_[v] == State::kQueued) return;
    FindTargets(v);
    if (targets_.empty() || targets_[0].first > squared_) return;
    state_[v] = State::kQueued;
    queue_.push({targets_[0].first, v});
  }

  void TryTargets(uint32_t v) {
    for (size_t i = 0; i < targets_.size() && targets_[i].first <= squared_; ++i) {
      const uint32_t target = targets_[i].second;
      if (!Fits(v, target) || !Places(v)) continue;
      CollapseInto(v, target);
      FindRing(target);
      const std::vector<RingVertex> around = ring_;
      if (!is_fixed_[target]) Push(target);
      for (const RingVertex& n : around) {
        if (!is_fixed_[n.vertex]) Push(n.vertex);
      }
      return;
    }
  }

  // Whether the surface keeps its topology (link condition) and no face turns over, as far as both are kept, if v goes
  // to `target`. ring_ is that of v. Fills moved_ with the faces that v has afterwards.
  bool Fits(uint32_t v, uint32_t target) {
    moved_.clear();
    vanished_.clear();
    size_t lost = 0, common = 0;
    ++mark_;
    for (const RingVertex& n : ring_) marks_[n.vertex] = mark_;
    for (const uint32_t f : faces_of_[target]) {
      for (const uint32_t n : faces_[f]) {
        if (n == target || marks_[n] != mark_) continue;
        ++common;
        marks_[n] = 0;
      }
    }
    for (const uint32_t f : faces_of_[v]) {
      Triangle face = faces_[f];
      if (std::find(face.begin(), face.end(), target) != face.end()) {
        ++lost;
        for (const uint32_t n : face) {
          if (n != v && n != target && LosesAll(n, v, target)) vanished_.push_back(n);
        }
        continue;
      }
      const Eigen::Vector3d before = Cross(face);
      std::replace(face.begin(), face.end(), v, target);
      const Eigen::Vector3d after = Cross(face);
      if (keeps_turn_ && before.squaredNorm() > 0 &&
          before.dot(after) <= kCollapseTurn * before.norm() * after.norm()) {
        return false;
      }
      moved_.push_back({f, face});
    }
    const bool keeps_topology = keeps_all_ || is_fixed_[target] != 0;
    return !moved_.empty() && (common == lost || !keeps_topology) && (vanished_.empty() || !keeps_topology) &&
           faces_of_[target].size() + moved_.size() <= kCollapseValence + lost &&
           (is_fixed_[target] == 0 || KeepsFixedEdges(v, target));
  }

  // Whether each edge of `target` and another fixed vertex keeps a face if v goes to `target`.
  bool KeepsFixedEdges(uint32_t v, uint32_t target) const {
    for (const uint32_t f : faces_of_[v]) {
      const Triangle& face = faces_[f];
      if (std::find(face.begin(), face.end(), target) == face.end()) continue;
      for (const uint32_t n : face) {
        if (n == v || n == target || !is_fixed_[n]) continue;
        const auto has_n = [n](const Triangle& other) {
          return std::find(other.begin(), other.end(), n) != other.end();
        };
        const bool stays =
            std::any_of(moved_.begin(), moved_.end(), [&](const auto& moved) { return has_n(moved.second); }) ||
            std::any_of(faces_of_[target].begin(), faces_of_[target].end(), [&](uint32_t other) {
              const Triangle& corners = faces_[other];
              return has_n(corners) && std::find(corners.begin(), corners.end(), v) == corners.end();
            });
        if (!stays) return false;
      }
    }
    return true;
  }

  // Whether all faces of n have v and `target`.
  bool LosesAll(uint32_t n, uint32_t v, uint32_t target) const {
    return std::all_of(faces_of_[n].begin(), faces_of_[n].end(), [&](uint32_t f) {
      const Triangle& face = faces_[f];
      return std::find(face.begin(), face.end(), v) != face.end() &&
             std::find(face.begin(), face.end(), target) != face.end();
    });
  }

  // Fills places_ with the nearest of the moved faces for each point; false if one is too far from all.
  bool Places(uint32_t v) {
    places_.clear();
    if (!Place(v)) return false;
    std::sort(vanished_.begin(), vanished_.end());
    vanished_.erase(std::unique(vanished_.begin(), vanished_.end()), vanished_.end());
    for (const uint32_t n : vanished_) {
      if (!Place(n)) return false;
    }
    for (const uint32_t f : faces_of_[v]) {
      for (uint32_t p = first_point_[f]; p != kNoCollapse; p = next_point_[p]) {
        if (!Place(p)) return false;
      }
    }
    return true;
  }

  bool Place(uint32_t point) {
    double nearest = std::numeric_limits<double>::infinity();
    uint32_t place = kNoCollapse;
    for (const auto& [f, face] : moved_) {
      const double squared = SquaredDistance(point, face);
      if (squared < nearest) {
        nearest = squared;
        place = f;
        if (squared <= kCollapseNear * squared_) break;
      }
    }
    places_.push_back({point, place});
    return nearest <= squared_;
  }

  void CollapseInto(uint32_t v, uint32_t target) {
    for (const uint32_t f : faces_of_[v]) {
      first_point_[f] = kNoCollapse;
      const Triangle& face = faces_[f];
      if (std::find(face.begin(), face.end(), target) == face.end()) continue;
      is_alive_[f] = 0;
      --left_;
      for (const uint32_t n : face) {
        if (n != v) std::erase(faces_of_[n], f);
      }
    }
    for (const auto& [f, face] : moved_) {
      faces_[f] = face;
      faces_of_[target].push_back(f);
    }
    for (const auto& [point, f] : places_) {
      next_point_[point] = first_point_[f];
      first_point_[f] = point;
    }
    faces_of_[v] = {};
    quadrics_[target].Add(quadrics_[v]);
  }

  Eigen::Vector3d centre_;
  std::vector<Eigen::Vector3d> positions_;  // about the centre
  std::vector<Triangle> faces_;
  std::vector<int32_t> labels_;
  size_t left_;
  double squared_ = 0;  // the square of the largest distance
  std::vector<uint8_t> is_alive_, is_fixed_;
  std::vector<std::vector<uint32_t>> faces_of_;
  std::vector<PlaneQuadric> quadrics_;
  // Vertices, then other points. Those that are no vertices of faces any more are in lists of faces near to them.
  std::vector<Eigen::Vector3d> points_;
  std::vector<uint32_t> first_point_, next_point_;
  std::vector<State> state_;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue_;
  std::vector<uint32_t> marks_;  // per vertex
  uint32_t mark_ = 0;
  bool keeps_all_ = true, keeps_turn_ = true;
  // Of the vertex that is looked at.
  std::vector<RingVertex> ring_;
  std::vector<Entry> targets_;
  std::vector<std::pair<uint32_t, Triangle>> moved_;
  std::vector<uint32_t> vanished_;  // vertices besides it that lose all faces
  std::vector<std::pair<uint32_t, uint32_t>> places_;
};

}  // namespace

Tiles3dLevel SimplifyTiles3d(const Tiles3dVertices& vertices, const Tiles3dFaces& faces, const Tiles3dTarget& target,
                             const std::vector<uint8_t>& fixed, const std::vector<Tiles3dPoint>& points) {
  const auto fixed_count = static_cast<size_t>(std::count(fixed.begin(), fixed.end(), 1));
  const size_t enough = target.min_faces + fixed_count, most = std::max(target.max_faces + fixed_count, enough);
  const size_t with_classes = std::max(target.class_faces + fixed_count, enough);
  double distance_m = target.distance_m;
  Tiles3dLevel level;
  {
    TileCollapser collapser(vertices, faces, points, fixed);
    collapser.Collapse(distance_m, enough);
    if (collapser.left() > with_classes) {
      collapser.KeepDistancesOnly();
      collapser.Collapse(distance_m, with_classes);
    }
    if (collapser.left() > with_classes) {
      collapser.AllowTurns();
      collapser.Collapse(distance_m, with_classes);
    }
    level = collapser.Level();
  }
  // What is left has many small pieces: leaves of trees, or a surface that is no manifold.
  double piece = 0;  // size of pieces that may be left out, as a part of the distance
  for (int step = 0; step < kCollapseRounds + kCollapseSteps && level.faces.size() > with_classes; ++step) {
    if (step > 0) piece = std::max(piece, kCollapsePiece);
    if (step >= kCollapseRounds) {
      if (level.faces.size() <= most) break;
      if (piece < kCollapseLargestPiece) {
        piece *= 2;
      } else {
        distance_m *= kCollapseGrowth;
      }
    }
    const Tiles3dPieceLimits limits = {distance_m, piece * distance_m, with_classes};
    level.faces = WithoutSmallTiles3dPieces(vertices, level.faces, fixed, limits, &level.points);
    TileCollapser collapser(vertices, level.faces, level.points, fixed);
    collapser.KeepDistancesOnly();
    collapser.AllowTurns();
    collapser.Collapse(distance_m, with_classes);
    level = collapser.Level();
  }
  return level;
}

}  // namespace tessera
