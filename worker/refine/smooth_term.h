// E_intra with one weight for all: thin plate by the umbrella operator, with a share of membrane (design: geometry
// step).
#ifndef TESSERA_WORKER_REFINE_SMOOTH_TERM_H_
#define TESSERA_WORKER_REFINE_SMOOTH_TERM_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"

namespace tessera {

struct SmoothWeights {
  double thin_plate = 1;  // of ½ Σ ‖(U v)_k‖² over vertices inside the surface, U v = v - mean of the one-ring
  double membrane = 0;    // of ½ Σ ‖v_a - v_b‖²/6 over edges with two faces
  double rim = 0;  // of ½ Σ ‖(U d)_k‖² along rims, d = v - start: rims get no smoothing of shape, only of movement
};

// The quadratic form E(v) = ½ ⟨v, A v⟩ + rim part on one mesh's topology. Fixed vertices take part but get no
// derivative. Const members may be called from any thread; results do not depend on the number of threads.
class SmoothTerm {
 public:
  using Positions = std::vector<Eigen::Vector3d>;

  // `fixed`: one flag a vertex or empty. A vertex on an edge that has not exactly two faces is on a rim; rims of fixed
  // vertices (tile cuts) get no terms. `mesh.vertices` is the start.
  SmoothTerm(const TriangleMesh& mesh, const std::vector<uint8_t>& fixed);

  double Energy(const Positions& v, const SmoothWeights& weights) const;
  // Overwrites `gradient` with dE/dv; zero at fixed vertices.
  void Gradient(const Positions& v, const SmoothWeights& weights, Positions* gradient) const;

  // Approximately solves (data + A) step = rhs by `sweeps` of the block-Jacobi-preconditioned Chebyshev iteration from
  // zero: what a vertex gets depends on no more than 2·sweeps rings about it. `data`: one symmetric positive
  // semidefinite 3x3 block a vertex. Steps of fixed vertices are zero.
  void SolveStep(const std::vector<Eigen::Matrix3d>& data, const Positions& rhs, const SmoothWeights& weights,
                 int sweeps, Positions* step) const;

  bool on_rim(size_t vertex) const { return rim_[vertex] != 0; }

 private:
  // A x for the quadratic form; with `rim_reference` the rim part sees x - reference.
  void Apply(const Positions& x, const SmoothWeights& weights, const Positions* rim_reference, Positions* out) const;
  void Umbrella(const Positions& x, const Positions* rim_reference, Positions* out) const;

  Positions start_;
  std::vector<uint8_t> fixed_;
  std::vector<uint8_t> rim_;
  std::vector<uint32_t> ring_begin_;  // one-ring of v: ring_[ring_begin_[v] .. ring_begin_[v + 1])
  std::vector<uint32_t> ring_;
  std::vector<uint8_t> ring_inner_;                      // the edge to that neighbour has two faces
  std::vector<std::array<uint32_t, 2>> rim_neighbours_;  // of rim vertices with exactly two rim edges
  std::vector<uint8_t> has_rim_row_;
  std::vector<double> diagonal_plate_, diagonal_rim_;  // of UᵀU
};

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_SMOOTH_TERM_H_
