#include "worker/refine/descent.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"

namespace tessera {

using Eigen::Vector3d;

namespace {
constexpr int64_t kGrain = 4096;
}  // namespace

void LimitFolding(const TriangleMesh& mesh, double min_turn_cosine, std::vector<Vector3d>* step) {
  constexpr int kPasses = 5;
  const int64_t faces = static_cast<int64_t>(mesh.faces.size());
  std::vector<uint8_t> turned(mesh.faces.size());
  for (int pass = 0; pass < kPasses; ++pass) {
    ParallelFor(faces, kGrain, [&](int64_t begin, int64_t end) {
      for (int64_t f = begin; f < end; ++f) {
        const Triangle& t = mesh.faces[f];
        const Vector3d a = mesh.vertices[t[0]] + (*step)[t[0]], b = mesh.vertices[t[1]] + (*step)[t[1]],
                       c = mesh.vertices[t[2]] + (*step)[t[2]];
        const Vector3d before = FaceCross(mesh, f), after = (b - a).cross(c - a);
        turned[f] = after.dot(before) < min_turn_cosine * after.norm() * before.norm() ||
                    after.squaredNorm() < 0.01 * before.squaredNorm();
      }
    });
    // A vertex is shortened once a pass, however many of its faces turn.
    std::vector<uint8_t> shorten(mesh.vertices.size());
    for (int64_t f = 0; f < faces; ++f) {
      if (!turned[f]) continue;
      for (uint32_t v : mesh.faces[f]) shorten[v] = 1;
    }
    const double factor = pass + 1 < kPasses ? 0.5 : 0;
    for (size_t v = 0; v < shorten.size(); ++v) {
      if (shorten[v]) (*step)[v] *= factor;
    }
  }
}

std::vector<Vector3d> ComputeStep(const TriangleMesh& mesh, const PhotoDerivatives& photo, const SmoothTerm& smooth,
                                  const StepOptions& options) {
  std::vector<Vector3d> rhs, step;
  smooth.Gradient(mesh.vertices, options.weights, &rhs);
  for (size_t v = 0; v < rhs.size(); ++v) rhs[v] = -(rhs[v] + photo.gradient[v]);
  smooth.SolveStep(photo.curvature, rhs, options.weights, options.smoothing_sweeps, &step);
  for (Vector3d& s : step) {
    const double length = s.norm();
    if (length > options.max_step_m) s *= options.max_step_m / length;
  }
  LimitFolding(mesh, options.min_turn_cosine, &step);
  return step;
}

}  // namespace tessera
