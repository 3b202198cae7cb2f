#include "worker/refine/edge_flips.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <queue>
#include <span>
#include <utility>

#include "absl/container/flat_hash_map.h"
#include "common/base/parallel.h"
#include "worker/refine/self_intersection.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr double kLeastAngle_rad = 10 * 3.14159265358979323846 / 180;  // of a face that a flip makes
constexpr double kLeastGain = 0.02;                                    // times the edge's length
constexpr int32_t kNone = -1, kSeveral = -2;

uint64_t KeyOf(uint32_t a, uint32_t b) { return static_cast<uint64_t>(std::min(a, b)) << 32 | std::max(a, b); }

double AngleBetween(const Vector3d& a, const Vector3d& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

double LeastAngle(const Vector3d& a, const Vector3d& b, const Vector3d& c) {
  return std::min({AngleBetween(b - a, c - a), AngleBetween(c - b, a - b), AngleBetween(a - c, b - c)});
}

// One group's mesh, and the faces of it that may not change.
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
    // Beyond an edge with one face another group may lie.
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
        if (edges_.find(key)->second[0] == f) Ask(key);
      }
    }
    while (!waiting_.empty()) {
      const Candidate best = waiting_.top();
      waiting_.pop();
      // Else a flip nearby changed it, and asked again.
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
    // The greatest gain first, of equal ones the lower edge.
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

  // No face f: the edge is not one of two faces that look the same way.
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

  // By how much the cost of an edge of `face` rises if that face's normal there becomes `normal`.
  double Rise(uint32_t a, uint32_t b, int32_t face, const Vector3d& normal) const {
    const Sides& sides = edges_.find(KeyOf(a, b))->second;
    const int32_t other = sides[0] == face ? sides[1] : sides[0];
    if (other < 0) return 0;
    return (At(a) - At(b)).norm() * ((normal - normals_[other]).norm() - (normals_[face] - normals_[other]).norm());
  }

  // By how much a flip of the edge lowers the cost; 0: it stays.
  double Gain(uint64_t key) const {
    const Quad q = QuadOf(key);
    if (q.f < 0 || frozen_[q.f] || frozen_[q.g] || q.c == q.d || edges_.contains(KeyOf(q.c, q.d))) return 0;
    if (!mesh_.labels.empty() && mesh_.labels[q.f] != mesh_.labels[q.g]) return 0;
    const Vertex &a = vertices_[q.a], &b = vertices_[q.b], &c = vertices_[q.c], &d = vertices_[q.d];
    // Another group may have an edge between two vertices of the border; a closed fan keeps three faces.
    if (c.on_border && d.on_border) return 0;
    if ((!a.on_border && a.faces <= 3) || (!b.on_border && b.faces <= 3)) return 0;
    const Vector3d new_f = Normal(q.a, q.d, q.c), new_g = Normal(q.d, q.b, q.c);
    const double length = (At(q.a) - At(q.b)).norm();
    const double gain = length * (normals_[q.f] - normals_[q.g]).norm() -
                        (At(q.c) - At(q.d)).norm() * (new_f - new_g).norm() - Rise(q.b, q.c, q.f, new_g) -
                        Rise(q.c, q.a, q.f, new_f) - Rise(q.a, q.d, q.g, new_f) - Rise(q.d, q.b, q.g, new_g);
    if (gain <= kLeastGain * length) return 0;
    const double least = std::min(LeastAngle(At(q.a), At(q.b), At(q.c)), LeastAngle(At(q.b), At(q.a), At(q.d)));
    const double after = std::min(LeastAngle(At(q.a), At(q.d), At(q.c)), LeastAngle(At(q.d), At(q.b), At(q.c)));
    if (after < std::min(least, kLeastAngle_rad)) return 0;
    return gain;
  }

  void Ask(uint64_t key) {
    const double gain = Gain(key);
    if (gain > 0) waiting_.push({gain, key});
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
    // Of these faces and the ones beside them all edges may gain anew.
    for (const int32_t face : {q.f, q.g}) {
      for (int k = 0; k < 3; ++k) {
        const uint64_t edge = KeyOf(mesh_.faces[face][k], mesh_.faces[face][(k + 1) % 3]);
        const Sides& sides = edges_.find(edge)->second;
        const int32_t beside = sides[0] == face ? sides[1] : sides[0];
        Ask(edge);
        if (beside < 0 || beside == q.f || beside == q.g) continue;
        for (int m = 0; m < 3; ++m) {
          const uint64_t next = KeyOf(mesh_.faces[beside][m], mesh_.faces[beside][(m + 1) % 3]);
          if (next != edge) Ask(next);
        }
      }
    }
  }

  TriangleMesh& mesh_;
  const std::vector<uint8_t>& frozen_;
  absl::flat_hash_map<uint64_t, Sides> edges_;
  std::vector<Vertex> vertices_;
  std::vector<Vector3d> normals_;  // of the faces, as they are
  std::priority_queue<Candidate> waiting_;
};

std::vector<uint32_t> ChangedFaces(const std::vector<Triangle>& before, const std::vector<Triangle>& after) {
  std::vector<uint32_t> changed;
  for (uint32_t f = 0; f < before.size(); ++f) {
    if (before[f] != after[f]) changed.push_back(f);
  }
  return changed;
}

// Flips until no more is gained. Where faces then cut others that they did not cut before, all is taken back and done
// again without these; if that goes on, the group stays as it was.
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
    if (attempt == 0 && !cut.empty()) cut_before = IntersectingFacePairs({mesh->vertices, before, {}});
    const std::vector<FacePair> anew = NewPairs(cut_before, cut);
    if (anew.empty()) return;
    mesh->faces = before;
    for (const FacePair& pair : anew) frozen[pair[0]] = frozen[pair[1]] = 1;
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
  ParallelFor(static_cast<int64_t>(begins.size()) - 1, 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      const std::span<const uint32_t> faces(order.data() + begins[i], begins[i + 1] - begins[i]);
      std::vector<uint32_t> vertices;
      for (const uint32_t f : faces) vertices.insert(vertices.end(), before[f].begin(), before[f].end());
      std::sort(vertices.begin(), vertices.end());
      vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
      TriangleMesh group;
      for (const uint32_t v : vertices) group.vertices.push_back(mesh->vertices[v]);
      for (const uint32_t f : faces) {
        Triangle& face = group.faces.emplace_back();
        for (int k = 0; k < 3; ++k) {
          const auto place = std::lower_bound(vertices.begin(), vertices.end(), before[f][k]);
          face[k] = static_cast<uint32_t>(place - vertices.begin());
        }
        if (!mesh->labels.empty()) group.labels.push_back(mesh->labels[f]);
      }
      FlipGroup(&group);
      for (size_t f = 0; f < faces.size(); ++f) {
        for (int k = 0; k < 3; ++k) mesh->faces[faces[f]][k] = vertices[group.faces[f][k]];
      }
    }
  });
  return ChangedFaces(before, mesh->faces);
}

}  // namespace tessera
