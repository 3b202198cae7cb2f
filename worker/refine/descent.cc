#include "worker/refine/descent.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <span>

#include "common/base/loops/indices_where.h"
#include "common/base/parallel.h"

namespace tessera {

using Eigen::Vector3d;
using Eigen::Vector3f;

namespace {

constexpr int64_t kGrain = 4096;
constexpr int64_t kFoldGrain = 512;

Vector3d CrossAt(const Triangle& t, const std::vector<Vector3d>& at) {
  return (at[t[1]] - at[t[0]]).cross(at[t[2]] - at[t[0]]);
}

// The elements of neighbours(i) for all i of `indices`, each once, in any order, whose flag is not set. Sets their
// flags.
template <class Neighbours>
std::vector<uint32_t> EachOnce(const std::vector<uint32_t>& indices, std::vector<uint8_t>* flags,
                               const Neighbours& neighbours) {
  std::vector<std::vector<uint32_t>> parts((indices.size() + kFoldGrain - 1) / kFoldGrain);
  ParallelFor(static_cast<int64_t>(indices.size()), kFoldGrain, [&](int64_t begin, int64_t end) {
    std::vector<uint32_t>& part = parts[static_cast<size_t>(begin / kFoldGrain)];
    for (int64_t i = begin; i < end; ++i) {
      for (const uint32_t k : neighbours(indices[static_cast<size_t>(i)])) {
        std::atomic_ref<uint8_t> flag((*flags)[k]);
        if (flag.load(std::memory_order_relaxed) == 0 && flag.exchange(1, std::memory_order_relaxed) == 0) {
          part.push_back(k);
        }
      }
    }
  });
  std::vector<uint32_t> all;
  for (const std::vector<uint32_t>& part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}

// Boundary vertices have no smoothing term of their own, so the interior's would pull them inwards step by step. They
// keep their position in plan, except at boundaries of walls (steeper than 45 degrees), increasingly so with
// steepness.
Vector3d BoundaryStep(const Vector3d& step, const Vector3d& normal, const Vector3d& up) {
  const Vector3d lift = up * up.dot(step);
  const double cosine = normal.dot(up);
  return lift + std::max(0.0, 1 - 2 * cosine * cosine) * (step - lift);
}

}  // namespace

std::vector<Vector3d> SmoothedPositions(const TriangleMesh& mesh, const CsrRows& faces_of_vertex,
                                        const std::vector<uint8_t>& fixed, int steps) {
  // In a closed fan every neighbour is a corner of exactly two faces.
  std::vector<uint8_t> moves(mesh.vertices.size());
  ParallelFor(mesh.vertices.size(), kGrain, [&](int64_t begin, int64_t end) {
    std::vector<uint32_t> ring;
    for (auto v = static_cast<size_t>(begin); v < static_cast<size_t>(end); ++v) {
      if (!fixed.empty() && fixed[v]) continue;
      ring.clear();
      for (uint32_t f : faces_of_vertex[v]) {
        for (uint32_t w : mesh.faces[f]) {
          if (w != v) ring.push_back(w);
        }
      }
      std::sort(ring.begin(), ring.end());
      bool closed = !ring.empty() && ring.size() % 2 == 0;
      for (size_t i = 0; closed && i < ring.size(); i += 2) {
        closed = ring[i] == ring[i + 1] && (i + 2 == ring.size() || ring[i + 2] != ring[i]);
      }
      moves[v] = closed;
    }
  });
  std::vector<Vector3d> at = mesh.vertices, next = at;
  for (int step = 0; step < steps; ++step) {
    ParallelForEach(at.size(), kGrain, [&](size_t v) {
      if (!moves[v]) return;
      Vector3d sum = Vector3d::Zero();
      for (uint32_t f : faces_of_vertex[v]) {
        for (uint32_t w : mesh.faces[f]) {
          if (w != v) sum += at[w];
        }
      }
      next[v] = 0.5 * at[v] + sum / (4.0 * static_cast<double>(faces_of_vertex[v].size()));
    });
    std::swap(at, next);
  }
  return at;
}

double MotionBound_m(const MotionLimits& limits) {
  return (1 + 1e-6) * std::max(limits.max_normal_m, limits.max_tangent_m);
}

std::vector<uint8_t> UnionOfFlags(std::vector<uint8_t> a, const std::vector<uint8_t>& b) {
  if (a.empty()) return b;
  for (size_t v = 0; v < b.size(); ++v) a[v] |= b[v];
  return a;
}

MotionGuard::MotionGuard(const StartSurface& start, const std::vector<uint8_t>& boundary, const MotionLimits& limits,
                         const std::vector<uint8_t>& frozen)
    : limits_(limits),
      surface_(start),
      faces_(surface_.mesh().faces),
      faces_of_vertex_(surface_.faces_of_vertex()),
      start_(surface_.mesh().vertices),
      fixed_(UnionOfFlags(boundary, frozen)) {
  smoothed_ = SmoothedPositions(surface_.mesh(), faces_of_vertex_, boundary, limits.start_smoothing_steps);
  start_normals_.resize(faces_.size());
  ParallelForEach(faces_.size(), kGrain, [&](size_t f) {
    start_normals_[f] = CrossAt(faces_[f], smoothed_).stableNormalized().cast<float>();
  });
  vertex_normals_.resize(start_.size());
  ParallelForEach(start_.size(), kGrain, [&](size_t v) {
    Vector3d sum = Vector3d::Zero();
    for (uint32_t f : faces_of_vertex_[v]) sum += CrossAt(faces_[f], smoothed_);
    vertex_normals_[v] = sum.stableNormalized().cast<float>();
  });
}

Vector3d MotionGuard::InBall(size_t v, const Vector3d& from_start) const {
  const double per_normal = 1 / limits_.max_normal_m, per_tangent = 1 / limits_.max_tangent_m;
  const Vector3d normal = vertex_normals_[v].cast<double>();
  return per_tangent * from_start + (per_normal - per_tangent) * normal.dot(from_start) * normal;
}

bool MotionGuard::Contains(size_t v, const Vector3d& at) const { return InBall(v, at - start_[v]).norm() <= 1; }

Vector3d MotionGuard::Braked(size_t v, const Vector3d& at, const Vector3d& step) const {
  const double per_normal = 1 / limits_.max_normal_m, per_tangent = 1 / limits_.max_tangent_m;
  if (std::max(per_normal, per_tangent) * ((at - start_[v]).norm() + step.norm()) <= limits_.free_share) return step;
  const Vector3d from = InBall(v, at - start_[v]), move = InBall(v, step);
  const double before = std::max(from.norm(), limits_.free_share), after = (from + move).norm();
  // A vertex of the second split may begin outside its own ellipsoid, but no farther from its start than one of the two
  // vertices that it lies between. It may go inside, or nearer to its start.
  if (before > 1 && after > 1 && (at + step - start_[v]).squaredNorm() > (at - start_[v]).squaredNorm()) {
    return Vector3d::Zero();
  }
  // A step may use at most half of the remaining distance to the ellipsoid's surface.
  const double most = before + std::max(0.0, 0.5 * (1 - before));
  if (after <= before || after <= most) return step;
  // The share of the step that reaches the ball of radius `most`.
  const double a = move.squaredNorm(), b = from.dot(move), c = std::min(0.0, from.squaredNorm() - most * most);
  return std::clamp((-b + std::sqrt(std::max(0.0, b * b - a * c))) / a, 0.0, 1.0) * step;
}

void MotionGuard::LimitDisplacement(const Positions& at, Positions* step) const {
  ParallelForEach(at.size(), kGrain, [&](size_t v) { (*step)[v] = Braked(v, at[v], (*step)[v]); });
}

bool MotionGuard::KeepsOrientation(uint32_t face, const Positions& from, const Positions& to) const {
  const Vector3d normal = start_normals_[face].cast<double>();
  const Vector3d after = CrossAt(faces_[face], to);
  const double facing = after.dot(normal), length = after.norm();
  if (facing >= limits_.min_start_cosine * length && length > 0) return true;
  const Vector3d before = CrossAt(faces_[face], from);
  return facing * before.norm() >= (before.dot(normal) - 1e-9 * before.norm()) * length;
}

std::vector<Vector3d> MotionGuard::RepairedStart() const {
  Positions out = start_;
  const auto turns = [&](uint32_t f) {
    const Vector3d cross = CrossAt(faces_[f], start_);
    return !(cross.dot(start_normals_[f].cast<double>()) >= limits_.min_start_cosine * cross.norm());
  };
  for (const uint32_t f : IndicesWhere(faces_.size(), kGrain, turns)) {
    for (uint32_t v : faces_[f]) out[v] = start_[v] + Braked(v, start_[v], smoothed_[v] - start_[v]);
  }
  return out;
}

int64_t MotionGuard::InvertedFaces(const Positions& at) const {
  int64_t count = 0;
  for (size_t f = 0; f < faces_.size(); ++f) count += CrossAt(faces_[f], at).dot(start_normals_[f].cast<double>()) <= 0;
  return count;
}

void MotionGuard::LimitFolding(const Positions& at, double min_turn_cosine, Positions* step) const {
  constexpr double kMinAreaShare = 0.1;  // relative to the area before the step
  const auto folds = [&](uint32_t f) {
    const Triangle& t = faces_[f];
    const Vector3d &p = at[t[0]], &q = at[t[1]], &r = at[t[2]];
    const Vector3d &u = (*step)[t[0]], &v = (*step)[t[1]], &w = (*step)[t[2]];
    const Vector3d before = (q - p).cross(r - p), after = (q + v - p - u).cross(r + w - p - u);
    const double before2 = before.squaredNorm(), after2 = after.squaredNorm();
    const Vector3d normal = start_normals_[f].cast<double>();
    const double facing = after.dot(normal), length = std::sqrt(after2);
    if (after.dot(before) >= min_turn_cosine * length * std::sqrt(before2) &&
        after2 >= kMinAreaShare * kMinAreaShare * before2 && facing >= limits_.min_start_cosine * length) {
      return false;
    }
    if (u.isZero(0) && v.isZero(0) && w.isZero(0)) return false;
    if (after.dot(before) < min_turn_cosine * length * std::sqrt(before2) ||
        after2 < kMinAreaShare * kMinAreaShare * before2) {
      return true;
    }
    return facing * std::sqrt(before2) < before.dot(normal) * length;
  };
  std::vector<uint8_t> folded(faces_.size());
  std::vector<uint32_t> bad = IndicesWhere(faces_.size(), kGrain, [&](uint32_t f) { return folded[f] = folds(f); });
  // From here on only faces next to a changed vertex can be newly folded. First the steps are averaged over the
  // corners of folding faces, then shortened. A vertex changes once per pass, however many of its faces fold, so the
  // result does not depend on the order of faces.
  std::vector<uint8_t> changed(at.size()), is_touched(faces_.size());
  std::vector<uint32_t> vertices, touched;
  Positions level;
  for (int pass = 0; pass < kFoldingPasses && !bad.empty(); ++pass) {
    vertices = EachOnce(bad, &changed, [&](uint32_t f) { return std::span<const uint32_t>(faces_[f]); });
    touched = EachOnce(vertices, &is_touched, [&](uint32_t v) { return faces_of_vertex_[v]; });
    if (pass < kSmoothingPasses) {
      level.resize(vertices.size());
      ParallelForEach(vertices.size(), kFoldGrain, [&](size_t i) {
        Vector3d sum = Vector3d::Zero();
        int corners = 0;
        for (uint32_t f : faces_of_vertex_[vertices[i]]) {
          if (!folded[f]) continue;
          for (uint32_t w : faces_[f]) sum += (*step)[w];
          corners += 3;
        }
        level[i] = sum / corners;
      });
      ParallelForEach(vertices.size(), kFoldGrain, [&](size_t i) {
        const uint32_t v = vertices[i];
        if (fixed_.empty() || !fixed_[v]) (*step)[v] = Braked(v, at[v], level[i]);
      });
    } else {
      for (uint32_t v : vertices) (*step)[v] *= 0.5;
    }
    for (uint32_t f : bad) folded[f] = 0;
    for (uint32_t v : vertices) changed[v] = 0;
    bad = IndicesWhere(touched.size(), kFoldGrain, [&](uint32_t i) {
      is_touched[touched[i]] = 0;
      return folded[touched[i]] = folds(touched[i]);
    });
    for (uint32_t& f : bad) f = touched[f];
  }
}

StepDependencyRadius StepDependencyRadiusOf(int smoothing_sweeps, const MotionLimits& limits) {
  StepDependencyRadius radius;
  radius.gradient = std::max(SmoothTerm::kGradientRings, InterTerm::kGradientRings);
  radius.sweeps = SmoothTerm::SolveRings(smoothing_sweeps);
  radius.start = limits.start_smoothing_steps + 1;
  radius.folding = MotionGuard::kFoldingPasses;
  return radius;
}

std::vector<Vector3d> ComputeStep(const std::vector<Vector3d>& at, const PhotoDerivatives& photo,
                                  const SmoothTerm& smooth, const InterTerm* inter, const MotionGuard& guard,
                                  const StepOptions& options, const std::vector<Vector3f>& last) {
  std::vector<Vector3d> rhs, step;
  smooth.Gradient(at, options.weights, &rhs);
  InterCurvature inter_curvature;
  if (options.inter > 0) {
    inter->AddGradient(at, options.inter, photo.pairs, &rhs);
    inter_curvature = inter->Curvature(at, options.inter, photo.pairs);
  }
  ParallelForEach(rhs.size(), kGrain, [&](size_t v) { rhs[v] = -(rhs[v] + photo.gradient[v]); });
  smooth.SolveStep(photo.curvature, rhs, options.weights, options.smoothing_sweeps, &step,
                   options.inter > 0 ? &inter_curvature : nullptr);
  ParallelForEach(step.size(), kGrain, [&](size_t v) {
    Vector3d& s = step[v];
    const double data = photo.curvature[v].trace();
    if (data > 0 && !s.isZero(0)) {  // fixed vertices keep a zero step
      const double share = data / (data + options.half_effect_curvature);
      s *= 1 + share * (options.acceleration.relaxation - 1);
      if (!last.empty()) s += share * options.acceleration.momentum * last[v].cast<double>();
    }
    if (smooth.on_boundary(v)) s = BoundaryStep(s, guard.start_normal(v), options.up);
    const double length = s.norm();
    if (length > options.max_step_m) s *= options.max_step_m / length;
  });
  guard.LimitDisplacement(at, &step);
  if (options.grid_m > 0) {
    ParallelForEach(step.size(), kGrain, [&](size_t v) {
      const Vector3d& from = at[v];
      if (step[v].isZero(0)) return;  // fixed
      const Vector3d to = options.grid_m * ((from + step[v]) / options.grid_m).array().round().matrix();
      if (guard.Contains(v, to)) step[v] = to - from;
    });
  }
  guard.LimitFolding(at, options.min_turn_cosine, &step);
  return step;
}

}  // namespace tessera
