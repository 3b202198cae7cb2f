// One step of the descent: data and smoothness balanced vertex by vertex, bounded, and kept from folding faces.
#ifndef TESSERA_WORKER_REFINE_DESCENT_H_
#define TESSERA_WORKER_REFINE_DESCENT_H_

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"
#include "worker/refine/photo_term.h"
#include "worker/refine/smooth_term.h"

namespace tessera {

struct StepOptions {
  SmoothWeights weights;  // per metre²
  int smoothing_sweeps = 10;
  double max_step_m = 0;
  double min_turn_cosine = 0.4;  // a face's normal turns by less than this angle's arc cosine in a step
};

// Shortens `step` at the corners of faces whose normals would turn too far: halved a few times, then dropped.
void LimitFolding(const TriangleMesh& mesh, double min_turn_cosine, std::vector<Eigen::Vector3d>* step);

// The Gauss-Newton step of photo and smoothness term at `mesh`: (curvature + A) step = -(gradients), every vertex's
// length bounded. Depends on no sum over the mesh. Zero at fixed vertices.
std::vector<Eigen::Vector3d> ComputeStep(const TriangleMesh& mesh, const PhotoDerivatives& photo,
                                         const SmoothTerm& smooth, const StepOptions& options);

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_DESCENT_H_
