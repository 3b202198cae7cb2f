#include "worker/refine/edge_flips.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <queue>
#include <span>

#include "absl/container/flat_hash_map.h"
#include "common/base/parallel.h"
#include "worker/refine/self_intersection.h"
#include "worker/refine/submesh.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr double kLeastAngle_rad = 10 * 3.14159265358979323846 / 180;  // minimum angle of a face after a flip
constexpr double kLeastGain = 0.02;                                    // relative to the edge's length
constexpr int32_t kNone = -1, kSeveral = -2;

uint64_t KeyOf(uint32_t a, uint32_t b) { return static_cast<uint64_t>(std::min(a, b)) << 32 | std::max(a, b); }

double AngleBetween(const Vector3d& a, const Vector3d& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

double LeastAngle(const Vector3d& a, const Vector3d& b, const Vector3d& c) {
  return std::min({AngleBetween(b - a, c - a), AngleBetween(c - b, a - b), AngleBetween(a - c, b - c)});
}

// Greedy flips in one group's mesh, without the faces flagged in `frozen`. A priority queue with lazy invalidation:
// an entry is only valid if its gain is still the current one. Ties are broken by the edge's key, so the result does
// not depend on the order of insertion.
class GroupFlipper {
 public:
  GroupFlipper(TriangleMesh* mesh, const std::vector<uint8_t>& frozen)
      : mesh_(*mesh), frozen_(frozen), vertices_(mesh->vertices.size()), normals_(mesh->faces.size()) {
    edges_.reserve(mesh_.faces.size() * 3 / 2 + 8);
    for (size_t f = 0; f < mesh_.faces.size(); ++f) {
      normals_[f] = FaceNormal(mesh_, f);
      for (int k = 0; k < 3; ++k) {
        const uint32_t a = mesh_.faces[f][k], b = mesh_.faces[f][(k + 1) % 3];
        const auto [edge, made] = edges_.try_emplace(KeyOf(a, b), Sides{static_cast<int32_t>(f), kNone});
        if (!made) edge->second[1] = edge->second[1] == kNone ? static_cast<int32_t>(f) : kSeveral;
        ++vertices_[a].faces;
      }
    }
    // Another group may continue beyond an edge with one face.
    for (const auto& [key, sides] : edges_) {
      if (sides[1] >= 0) continue;
      vertices_[static_cast<uint32_t>(key >> 32)].on_border = true;
      vertices_[static_cast<uint32_t>(key)].on_border = true;
    }
  }

  void Run() {
    for (int32_t f = 0; f < static_cast<int32_t>(mesh_.faces.size()); ++f) {
      for (int k = 0; k < 3; ++k) {
        const uint64_t key = KeyOf(mesh_.faces[f][k], mesh_.faces[f][(k + 1) % 3]);
        if (edges_.find(key)->second[0] == f) Enqueue(key);
      }
    }
    while (!queue_.empty()) {
      const Candidate best = queue_.top();
      queue_.pop();
      // Otherwise a flip nearby changed the gain and has added a new entry.
      if (Gain(best.key) == best.gain) Flip(best.key);
    }
  }

 private:
  using Sides = std::array<int32_t, 2>;  // the faces of an edge
  struct Vertex {
    int faces = 0;
    bool on_border = false;
  };
  struct Candidate {
    double gain;
    uint64_t key;
    // Largest gain first; of equal ones the lower key.
    bool operator<(const Candidate& other) const { return gain != other.gain ? gain < other.gain : key > other.key; }
  };
  // Face f is (a, b, c), face g (b, a, d); flipped they are (a, d, c) and (d, b, c).
  struct Quad {
    int32_t f = kNone, g = kNone;
    uint32_t a = 0, b = 0, c = 0, d = 0;
  };

  const Vector3d& At(uint32_t vertex) const { return mesh_.vertices[vertex]; }
  Vector3d Normal(uint32_t a, uint32_t b, uint32_t c) const {
    return (At(b) - At(a)).cross(At(c) - At(a)).stableNormalized();
  }

  // f = kNone: the edge does not have exactly two faces of consistent orientation.
  Quad QuadOf(uint64_t key) const {
    Quad quad;
    const auto edge = edges_.find(key);
    if (edge == edges_.end() || edge->second[0] < 0 || edge->second[1] < 0) return quad;
    const Triangle& f = mesh_.faces[edge->second[0]];
    const Triangle& g = mesh_.faces[edge->second[1]];
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = f[k], b = f[(k + 1) % 3];
      if (KeyOf(a, b) != key) continue;
      for (int m = 0; m < 3; ++m) {
        if (g[m] == b && g[(m + 1) % 3] == a) {
          return {edge->second[0], edge->second[1], a, b, f[(k + 2) % 3], g[(m + 2) % 3]};
        }
      }
    }
    return quad;
  }

  // Increase of the cost of an edge of `face` if the face's normal becomes `normal`.
  double CostIncrease(uint32_t a, uint32_t b, int32_t face, const Vector3d& normal) const {
    const Sides& sides = edges_.find(KeyOf(a, b))->second;
    const int32_t other = sides[0] == face ? sides[1] : sides[0];
    if (other < 0) return 0;
    return (At(a) - At(b)).norm() * ((normal - normals_[other]).norm() - (normals_[face] - normals_[other]).norm());
  }

  // Decrease of the total cost by a flip of the edge; 0: not allowed or not worth it.
  double Gain(uint64_t key) const {
    const Quad q = QuadOf(key);
    if (q.f < 0 || frozen_[q.f] || frozen_[q.g] || q.c == q.d || edges_.contains(KeyOf(q.c, q.d))) return 0;
    if (!mesh_.labels.empty() && mesh_.labels[q.f] != mesh_.labels[q.g]) return 0;
    const Vertex &a = vertices_[q.a], &b = vertices_[q.b], &c = vertices_[q.c], &d = vertices_[q.d];
    // Two border vertices may already be connected in another group. A closed fan needs at least three faces.
    if (c.on_border && d.on_border) return 0;
    if ((!a.on_border && a.faces <= 3) || (!b.on_border && b.faces <= 3)) return 0;
    const Vector3d new_f = Normal(q.a, q.d, q.c), new_g = Normal(q.d, q.b, q.c);
    const double length = (At(q.a) - At(q.b)).norm();
    const double gain = length * (normals_[q.f] - normals_[q.g]).norm() -
                        (At(q.c) - At(q.d)).norm() * (new_f - new_g).norm() - CostIncrease(q.b, q.c, q.f, new_g) -
                        CostIncrease(q.c, q.a, q.f, new_f) - CostIncrease(q.a, q.d, q.g, new_f) -
                        CostIncrease(q.d, q.b, q.g, new_g);
    if (gain <= kLeastGain * length) return 0;
    const double least = std::min(LeastAngle(At(q.a), At(q.b), At(q.c)), LeastAngle(At(q.b), At(q.a), At(q.d)));
    const double after = std::min(LeastAngle(At(q.a), At(q.d), At(q.c)), LeastAngle(At(q.d), At(q.b), At(q.c)));
    if (after < std::min(least, kLeastAngle_rad)) return 0;
    return gain;
  }

  void Enqueue(uint64_t key) {
    const double gain = Gain(key);
    if (gain > 0) queue_.push({gain, key});
  }

  void Replace(uint32_t a, uint32_t b, int32_t from, int32_t to) {
    Sides& sides = edges_.find(KeyOf(a, b))->second;
    sides[sides[0] == from ? 0 : 1] = to;
  }

  void Flip(uint64_t key) {
    const Quad q = QuadOf(key);
    mesh_.faces[q.f] = {q.a, q.d, q.c};
    mesh_.faces[q.g] = {q.d, q.b, q.c};
    normals_[q.f] = FaceNormal(mesh_, q.f);
    normals_[q.g] = FaceNormal(mesh_, q.g);
    edges_.erase(key);
    edges_[KeyOf(q.c, q.d)] = {q.f, q.g};
    Replace(q.b, q.c, q.f, q.g);
    Replace(q.a, q.d, q.g, q.f);
    --vertices_[q.a].faces;
    --vertices_[q.b].faces;
    ++vertices_[q.c].faces;
    ++vertices_[q.d].faces;
    // The gains of all edges of these faces and of the adjacent faces may have changed.
    for (const int32_t face : {q.f, q.g}) {
      for (int k = 0; k < 3; ++k) {
        const uint64_t edge = KeyOf(mesh_.faces[face][k], mesh_.faces[face][(k + 1) % 3]);
        const Sides& sides = edges_.find(edge)->second;
        const int32_t beside = sides[0] == face ? sides[1] : sides[0];
        Enqueue(edge);
        if (beside < 0 || beside == q.f || beside == q.g) continue;
        for (int m = 0; m < 3; ++m) {
          const uint64_t next = KeyOf(mesh_.faces[beside][m], mesh_.faces[beside][(m + 1) % 3]);
          if (next != edge) Enqueue(next);
        }
      }
    }
  }

  TriangleMesh& mesh_;
  const std::vector<uint8_t>& frozen_;
  absl::flat_hash_map<uint64_t, Sides> edges_;
  std::vector<Vertex> vertices_;
  std::vector<Vector3d> normals_;  // current normals of the faces
  std::priority_queue<Candidate> queue_;
};

std::vector<uint32_t> ChangedFaces(const std::vector<Triangle>& before, const std::vector<Triangle>& after) {
  std::vector<uint32_t> changed;
  for (uint32_t f = 0; f < before.size(); ++f) {
    if (before[f] != after[f]) changed.push_back(f);
  }
  return changed;
}

// Flips until no gain is left, then tests for new intersections, which would be expensive to test per flip. If there
// are any, restarts from the original faces with the intersecting ones frozen; after kAttempts the group stays
// unchanged.
void FlipGroup(TriangleMesh* mesh) {
  constexpr int kAttempts = 8;
  const std::vector<Triangle> before = mesh->faces;
  std::vector<uint8_t> frozen(before.size());
  FaceBoxes boxes(*mesh);
  std::vector<FacePair> cut_before;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    GroupFlipper(mesh, frozen).Run();
    const std::vector<uint32_t> changed = ChangedFaces(before, mesh->faces);
    if (changed.empty()) return;
    boxes.Refit(*mesh);
    const std::vector<FacePair> cut = boxes.Intersections(*mesh, changed);
    if (attempt == 0 && !cut.empty()) cut_before = IntersectingFacePairs(TriangleMesh{mesh->vertices, before, {}});
    const std::vector<FacePair> new_pairs = NewPairs(cut_before, cut);
    if (new_pairs.empty()) return;
    mesh->faces = before;
    for (const FacePair& pair : new_pairs) frozen[pair[0]] = frozen[pair[1]] = 1;
  }
}

}  // namespace

std::vector<uint32_t> FlipEdges(const std::vector<uint64_t>& groups, TriangleMesh* mesh) {
  std::vector<uint32_t> order(mesh->faces.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return groups[a] < groups[b]; });
  std::vector<size_t> begins;
  for (size_t i = 0; i < order.size(); ++i) {
    if (i == 0 || groups[order[i]] != groups[order[i - 1]]) begins.push_back(i);
  }
  begins.push_back(order.size());
  const std::vector<Triangle> before = mesh->faces;
  MeshSpans unflipped(*mesh);
  unflipped.faces = before;
  ParallelForEach(static_cast<int64_t>(begins.size()) - 1, 1, [&](int64_t i) {
    const std::span<const uint32_t> faces(order.data() + begins[i], begins[i + 1] - begins[i]);
    Submesh group = ExtractFaces(unflipped, faces);
    FlipGroup(&group.mesh);
    for (size_t f = 0; f < faces.size(); ++f) {
      for (int k = 0; k < 3; ++k) mesh->faces[faces[f]][k] = group.vertices[group.mesh.faces[f][k]];
    }
  });
  return ChangedFaces(before, mesh->faces);
}

}  // namespace tessera
