#include "worker/refine/self_intersection.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <utility>

#include "common/base/loops/indices_where.h"
#include "common/base/loops/parallel_sort.h"
#include "common/base/parallel.h"
#include "worker/refine/morton.h"

namespace tessera {
namespace {

using Eigen::Vector3d;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;

constexpr size_t kLeafFaces = 4;
constexpr int64_t kGrain = 2048, kLeafGrain = 512;

Point ToPoint(const Vector3d& p) { return {p.x(), p.y(), p.z()}; }

using Corners = std::array<Vector3d, 3>;

// Separation test: true if the plane of `t`, or a plane through an edge of it and the shared corners, has all
// unshared corners of `o` on its far side, by more than the rounding error. The `shared` common corners come first in
// both.
bool SeparatedByPlaneOf(const Corners& t, const Corners& o, int shared) {
  constexpr double kError = 1e-13;  // of a point's signed distance, relative to the lengths involved
  const std::array<Vector3d, 3> edge = {t[1] - t[0], t[2] - t[1], t[0] - t[2]};
  const std::array<double, 3> length = {edge[0].norm(), edge[1].norm(), edge[2].norm()};
  const Vector3d normal = edge[0].cross(edge[1]);
  const auto side = [&](const Vector3d& axis, double axis_length, const Vector3d& origin) {
    int above = 0, below = 0;
    for (int k = shared; k < 3; ++k) {
      const Vector3d d = o[k] - origin;
      const double at = axis.dot(d), error = kError * axis_length * d.lpNorm<1>();
      above += at > error;
      below += at < -error;
    }
    return above == 3 - shared ? 1 : below == 3 - shared ? -1 : 0;
  };
  const double scale = length[0] * length[1];
  if (side(normal, scale, t[0]) != 0) return true;
  for (int k = 0; k < 3; ++k) {
    if ((shared == 1 && k == 1) || (shared == 2 && k != 0)) continue;
    const Vector3d& origin = shared > 0 ? t[0] : t[static_cast<size_t>(k)];
    if (side(edge[k].cross(normal), scale * length[k], origin) > 0) return true;
  }
  return false;
}

bool Separated(const Corners& a, const Corners& b, int shared) {
  return SeparatedByPlaneOf(a, b, shared) || SeparatedByPlaneOf(b, a, shared);
}

// Exact test. The shared corners come first in both.
bool Meet(const Corners& a, const Corners& b, int shared) {
  const std::array<Point, 3> p = {ToPoint(a[0]), ToPoint(a[1]), ToPoint(a[2])};
  const std::array<Point, 3> q = {ToPoint(b[0]), ToPoint(b[1]), ToPoint(b[2])};
  if (CGAL::collinear(p[0], p[1], p[2]) || CGAL::collinear(q[0], q[1], q[2])) return false;
  if (shared == 3) return true;
  if (shared == 2) {
    return CGAL::coplanar(p[0], p[1], p[2], q[2]) &&
           CGAL::coplanar_orientation(p[0], p[1], p[2], q[2]) == CGAL::POSITIVE;
  }
  const Kernel::Triangle_3 first(p[0], p[1], p[2]), second(q[0], q[1], q[2]);
  if (shared == 1) {
    return CGAL::do_intersect(first, Kernel::Segment_3(q[1], q[2])) ||
           CGAL::do_intersect(second, Kernel::Segment_3(p[1], p[2]));
  }
  return CGAL::do_intersect(first, second);
}

bool FacesMeet(const MeshSpans& mesh, uint32_t f, uint32_t g) {
  Triangle s = mesh.faces[f], t = mesh.faces[g];
  int shared = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = shared; j < 3; ++j) {
      if (s[i] != t[j]) continue;
      std::swap(s[i], s[shared]);
      std::swap(t[j], t[shared]);
      ++shared;
      break;
    }
  }
  const Corners a = {mesh.vertices[s[0]], mesh.vertices[s[1]], mesh.vertices[s[2]]};
  const Corners b = {mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]};
  return !Separated(a, b, shared) && Meet(a, b, shared);
}

}  // namespace

FaceBoxes::FaceBoxes(const MeshSpans& mesh) {
  std::vector<Vector3d> centroids(mesh.faces.size());
  ParallelForEach(centroids.size(), kGrain, [&](size_t f) { centroids[f] = mesh.Centroid(f); });
  const std::vector<uint64_t> keys = MortonKeys(centroids);
  std::vector<std::pair<uint64_t, uint32_t>> coded(mesh.faces.size());
  ParallelForEach(coded.size(), kGrain, [&](size_t f) { coded[f] = {keys[f], static_cast<uint32_t>(f)}; });
  ParallelSort(&coded);
  for (const auto& [code, face] : coded) order_.push_back(face);
  while (leaves_ * kLeafFaces < order_.size()) leaves_ *= 2;
  Refit(mesh);
}

void FaceBoxes::Refit(const MeshSpans& mesh) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const Box nothing = {{kInfinity, kInfinity, kInfinity}, {-kInfinity, -kInfinity, -kInfinity}};
  face_boxes_.resize(order_.size());
  nodes_.resize(2 * leaves_);
  const auto widen = [](Box& box, const Box& other) {
    for (int k = 0; k < 3; ++k) {
      box.low[k] = std::min(box.low[k], other.low[k]);
      box.high[k] = std::max(box.high[k], other.high[k]);
    }
  };
  ParallelForEach(order_.size(), kGrain * 4, [&](int64_t i) {
    const size_t f = order_[i];
    const Vector3d& a = mesh.Corner(f, 0);
    const Vector3d& b = mesh.Corner(f, 1);
    const Vector3d& c = mesh.Corner(f, 2);
    for (int k = 0; k < 3; ++k) {
      const double low = std::min({a[k], b[k], c[k]}), high = std::max({a[k], b[k], c[k]});
      // Rounding to float must not shrink a box.
      face_boxes_[i].low[k] = static_cast<float>(low - 1e-7 * std::abs(low));
      face_boxes_[i].high[k] = static_cast<float>(high + 1e-7 * std::abs(high));
    }
  });
  ParallelForEach(leaves_, kGrain, [&](size_t leaf) {
    Box box = nothing;
    for (size_t i = leaf * kLeafFaces; i < std::min((leaf + 1) * kLeafFaces, order_.size()); ++i) {
      widen(box, face_boxes_[i]);
    }
    nodes_[leaves_ + leaf] = box;
  });
  // Level by level, from the leaves to the root.
  for (size_t first = leaves_ / 2; first > 0; first /= 2) {
    ParallelForEach(first, kGrain * 2, [&](size_t i) {
      Box box = nodes_[2 * (first + i)];
      widen(box, nodes_[2 * (first + i) + 1]);
      nodes_[first + i] = box;
    });
  }
}

bool FaceBoxes::Overlap(const Box& a, const Box& b) const {
  return (a.low[0] <= b.high[0]) & (b.low[0] <= a.high[0]) & (a.low[1] <= b.high[1]) & (b.low[1] <= a.high[1]) &
         (a.low[2] <= b.high[2]) & (b.low[2] <= a.high[2]);
}

std::vector<FacePair> FaceBoxes::Intersections(const MeshSpans& mesh, const std::vector<uint32_t>& active) const {
  if (active.empty()) return {};
  std::vector<uint8_t> is_active(mesh.faces.size());
  for (uint32_t f : active) is_active[f] = 1;
  // Leaf by leaf along the curve. A pair of two active faces is found by the earlier one.
  const auto is_active_at = [&](size_t i) { return is_active[order_[i]] != 0; };
  const auto faces_end = [&](size_t leaf) { return std::min((leaf + 1) * kLeafFaces, order_.size()); };
  std::vector<uint8_t> all_active(2 * leaves_, 1);  // per node: no face below it is inactive
  const std::vector<uint32_t> queries =
      IndicesWhere((order_.size() + kLeafFaces - 1) / kLeafFaces, kGrain, [&](size_t leaf) {
        bool any = false;
        for (size_t i = leaf * kLeafFaces; i < faces_end(leaf); ++i) {
          any |= is_active_at(i);
          all_active[leaves_ + leaf] &= static_cast<uint8_t>(is_active_at(i));
        }
        return any;
      });
  for (size_t n = leaves_; n-- > 1;) all_active[n] = all_active[2 * n] & all_active[2 * n + 1];
  const auto count = static_cast<int64_t>(queries.size());
  std::vector<std::vector<FacePair>> found(static_cast<size_t>((count + kLeafGrain - 1) / kLeafGrain));
  ParallelFor(count, kLeafGrain, [&](int64_t begin, int64_t end) {
    std::vector<FacePair>& out = found[static_cast<size_t>(begin / kLeafGrain)];
    std::vector<size_t> stack;
    for (int64_t q = begin; q < end; ++q) {
      const size_t leaf = queries[static_cast<size_t>(q)];
      const Box& box = nodes_[leaves_ + leaf];
      stack.assign(1, 1);
      while (!stack.empty()) {
        const size_t node = stack.back();
        stack.pop_back();
        // Earlier leaves have already found the pairs with their active faces.
        const size_t span = leaves_ >> (std::bit_width(node) - 1);
        if (all_active[node] && (node + 1) * span <= leaves_ + leaf) continue;
        if (!Overlap(nodes_[node], box)) continue;
        if (node < leaves_) {
          stack.push_back(2 * node + 1);
          stack.push_back(2 * node);
          continue;
        }
        const size_t other = node - leaves_;
        for (size_t i = leaf * kLeafFaces; i < faces_end(leaf); ++i) {
          if (!is_active_at(i)) continue;
          for (size_t j = other * kLeafFaces; j < faces_end(other); ++j) {
            if (j == i || (j < i && is_active_at(j)) || !Overlap(face_boxes_[i], face_boxes_[j])) continue;
            const FacePair pair = {std::min(order_[i], order_[j]), std::max(order_[i], order_[j])};
            if (FacesMeet(mesh, pair[0], pair[1])) out.push_back(pair);
          }
        }
      }
    }
  });
  std::vector<FacePair> pairs;
  for (const std::vector<FacePair>& part : found) pairs.insert(pairs.end(), part.begin(), part.end());
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

std::vector<FacePair> IntersectingFacePairs(const MeshSpans& mesh) {
  std::vector<uint32_t> all(mesh.faces.size());
  std::iota(all.begin(), all.end(), 0u);
  return FaceBoxes(mesh).Intersections(mesh, all);
}

std::vector<FacePair> NewPairs(const std::vector<FacePair>& before, const std::vector<FacePair>& after) {
  std::vector<FacePair> out;
  std::set_difference(after.begin(), after.end(), before.begin(), before.end(), std::back_inserter(out));
  return out;
}

SurfaceRepair::SurfaceRepair(const TriangleMesh& start, const CsrRows& faces_of_vertex)
    : start_(start), faces_of_vertex_(faces_of_vertex), boxes_(start) {}

// A motion from `good` to `proposed`, of which each vertex keeps a share in [0, 1].
class SurfaceRepair::Motion {
 public:
  Motion(const std::vector<Triangle>& faces, const CsrRows& faces_of_vertex, const Positions& good, Positions proposed)
      : faces_(faces),
        faces_of_vertex_(faces_of_vertex),
        good_(good),
        proposed_(std::move(proposed)),
        at_(proposed_),
        share_(good.size(), 1),
        rings_(good.size()) {}

  const Positions& at() const { return at_; }
  bool changed(uint32_t vertex) const { return share_[vertex] < 1 && proposed_[vertex] != good_[vertex]; }

  // Those of the faces `tested` (flags; empty: all) that have a moving corner, ascending.
  std::vector<uint32_t> MovingFaces(const std::vector<uint8_t>& tested) const {
    const auto moves = [&](uint32_t v) { return proposed_[v] != good_[v]; };
    return IndicesWhere(faces_.size(), kGrain, [&](uint32_t f) {
      return (tested.empty() || tested[f]) && std::any_of(faces_[f].begin(), faces_[f].end(), moves);
    });
  }

  // Applies a pass. Returns the faces that moved, ascending.
  std::vector<uint32_t> MoveBack(const std::vector<uint32_t>& defective, const Pass& pass) {
    std::fill(rings_.begin(), rings_.end(), -1);
    std::vector<uint32_t> front, next, moved;
    for (uint32_t f : defective) {
      for (uint32_t v : faces_[f]) Visit(v, 0, &front);
    }
    for (int ring = 0; ring < pass.rings; ++ring) {
      for (uint32_t v : front) Reduce(v, pass.least + (1 - pass.least) * ring / pass.rings, &moved);
      next.clear();
      for (uint32_t v : front) {
        for (uint32_t f : faces_of_vertex_[v]) {
          for (uint32_t w : faces_[f]) Visit(w, ring + 1, &next);
        }
      }
      std::swap(front, next);
    }
    SortUnique(&moved);
    return moved;
  }

  // `moved`: faces that moved last; adds those that move here.
  void ReduceAtInvertedFaces(const FaceTest& test, std::vector<uint32_t>* moved) {
    std::vector<uint32_t> moved_last = *moved;
    std::vector<std::pair<uint32_t, double>> shares;
    for (int round = 0; round < kSmoothingPasses && !moved_last.empty(); ++round) {
      shares.clear();
      for (uint32_t f : moved_last) {
        if (test(f, good_, at_)) continue;
        const auto& [a, b, c] = faces_[f];
        const auto [least, most] = std::minmax({share_[a], share_[b], share_[c]});
        const double share = round + 2 >= kSmoothingPasses ? 0 : least == most ? 0.5 * least : least;
        for (uint32_t v : faces_[f]) shares.push_back({v, share});
      }
      moved_last.clear();
      for (const auto& [v, share] : shares) Reduce(v, share, &moved_last);
      SortUnique(&moved_last);
      moved->insert(moved->end(), moved_last.begin(), moved_last.end());
    }
    SortUnique(moved);
  }

 private:
  static void SortUnique(std::vector<uint32_t>* values) {
    std::sort(values->begin(), values->end());
    values->erase(std::unique(values->begin(), values->end()), values->end());
  }

  void Visit(uint32_t v, int ring, std::vector<uint32_t>* front) {
    if (rings_[v] >= 0) return;
    rings_[v] = ring;
    front->push_back(v);
  }

  void Reduce(uint32_t v, double share, std::vector<uint32_t>* moved) {
    if (share >= share_[v]) return;
    share_[v] = share;
    if (proposed_[v] == good_[v]) return;
    at_[v] = good_[v] + share * (proposed_[v] - good_[v]);
    moved->insert(moved->end(), faces_of_vertex_[v].begin(), faces_of_vertex_[v].end());
  }

  const std::vector<Triangle>& faces_;
  const CsrRows& faces_of_vertex_;
  const Positions& good_;
  const Positions proposed_;
  Positions at_;
  std::vector<double> share_;
  std::vector<int> rings_;  // distance from a defective face in the current pass; -1: not reached
};

SurfaceRepair::Result SurfaceRepair::Run(const Positions& good, const FaceTest& test, Positions* vertices,
                                         const std::vector<uint8_t>& tested) {
  Motion motion(start_.faces, faces_of_vertex_, good, *vertices);
  const auto mesh_at = [&](const Positions& positions) { return MeshSpans(positions, start_.faces); };
  // Only faces that moved can have new defects.
  std::vector<uint32_t> active = motion.MovingFaces(tested), defective;
  Result result;
  std::vector<FacePair> cut;  // intersecting pairs that intersect neither at the start nor in `good`
  std::vector<uint8_t> is_defective(start_.faces.size()), moved(start_.faces.size());
  // Stop at the first pass without defects anywhere, since later passes would find the same. A region without defects
  // must not stop early on its own account, because the passes of other regions must not depend on it.
  for (size_t pass = 0;; ++pass) {
    boxes_.Refit(mesh_at(motion.at()));
    // Results for pairs of faces that have not moved since remain valid.
    if (!cut.empty()) {
      for (uint32_t f : active) moved[f] = 1;
      std::erase_if(cut, [&](const FacePair& p) { return moved[p[0]] || moved[p[1]]; });
      for (uint32_t f : active) moved[f] = 0;
    }
    for (const FacePair& p : boxes_.Intersections(mesh_at(motion.at()), active)) {
      if (FacesMeet(start_, p[0], p[1])) continue;
      if (!FacesMeet(mesh_at(good), p[0], p[1])) cut.push_back(p);
    }
    for (uint32_t f : defective) is_defective[f] = test && !test(f, good, motion.at());
    if (test) {
      ParallelForEach(active.size(), kGrain, [&](int64_t i) {
        const uint32_t f = active[static_cast<size_t>(i)];
        is_defective[f] = !test(f, good, motion.at());
      });
    }
    for (const FacePair& p : cut) is_defective[p[0]] = is_defective[p[1]] = 1;
    defective = IndicesWhere(is_defective.size(), kGrain * 8, [&](uint32_t f) { return is_defective[f] != 0; });
    if (defective.empty() || pass == kPasses.size()) break;
    ++result.passes;
    active = motion.MoveBack(defective, kPasses[pass]);
    if (test) motion.ReduceAtInvertedFaces(test, &active);
  }
  result.left = std::move(defective);
  const auto vertex_count = static_cast<int64_t>(good.size());
  result.changed_vertices = static_cast<int64_t>(ParallelSum(vertex_count, kGrain, [&](int64_t begin, int64_t end) {
    double changed = 0;
    for (int64_t v = begin; v < end; ++v) changed += motion.changed(static_cast<uint32_t>(v));
    return changed;
  }));
  *vertices = motion.at();
  return result;
}

}  // namespace tessera
