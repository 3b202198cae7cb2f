// E_intra: thin plate by the umbrella operator with a weight a class, and a share of membrane (Bláha et al. 2017,
// section 3.1).
#ifndef TESSERA_WORKER_REFINE_SMOOTH_TERM_H_
#define TESSERA_WORKER_REFINE_SMOOTH_TERM_H_

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "common/geometry/mesh.h"
#include "worker/refine/one_rings.h"

namespace tessera {

struct InterCurvature;

// How smooth a class is to be, relative to the weights below.
struct ClassSmoothness {
  double smoothness = 1;  // ω: of thin plate and membrane
  double keep = 0;        // of the distance from the start's faces of this class (SmoothWeights::keep)
};

struct SmoothWeights {
  double thin_plate = 1;  // of ½ Σ ω(v) ‖(U v)_k‖² over vertices inside the surface, U v = v - mean of the one-ring
  double membrane = 0;  // of ½ Σ ω(edge) ‖v_a - v_b‖²/6 over edges with two faces, not both ends on a rim
  double rim = 0;  // of ½ Σ ‖(U d)_k‖² along rims, d = v - start: rims get no smoothing of shape, only of movement
  double keep = 1;  // of ½ Σ_k mean over the faces f about k of keep(f) (n_f · (v_k - start_k))²
};

// Where a surface bends it may be an edge of what was built, where it is flat it is to be flat: a vertex's weight of
// thin plate and membrane is multiplied by flat / (1 + s / (1 + rough max(0, r - s))), s = (b / bend)², b = |n·U v|
// over the mean length of its edges on the surface after a few smoothing steps, which take most of the noise. On a
// right-angled edge that regular faces run along b is .41 before these steps and .19 after them (kCreaseShrinks); where
// it shrinks by more, what bends is finer: r is what s would be by the bend before. Noise shrinks to .10 to .15 of
// itself; edges that cut across faces to .35 to .40, so that these are let go less.
struct CreaseWeights {
  double bend = 0;   // 0: off, all weights stay
  double flat = 1;   // >= 0
  double rough = 0;  // >= 0; 0: whatever bends is an edge
};

// The quadratic form E(v) = ½ ⟨v, A v⟩ - ⟨c, v⟩ + const on one mesh's topology. Fixed vertices take part but get no
// derivative. Const members may be called from any thread; results do not depend on the number of threads.
class SmoothTerm {
 public:
  using Positions = std::vector<Eigen::Vector3d>;

  // `fixed`: flags of boundary and frozen vertices, one a vertex or empty. Rims of fixed vertices get no terms.
  // `mesh.vertices` is the start. One class of weight 1 until SetLabels; labels of `mesh` are ignored. `active`: flags
  // of the vertices whose steps SolveStep finds; empty: all.
  SmoothTerm(const TriangleMesh& mesh, const std::vector<uint8_t>& fixed, const std::vector<uint8_t>& active = {});

  // `labels`: one a face (-1 or 255: unlabelled, a class of its own with weight 1), or empty: one class of weight 1.
  // Classes beyond the end of `classes` have weight 1. Vertices whose faces have several labels get weight `mixed`
  // (0: none), so do edges between two of them. Linear in the mesh; may be called again and again.
  void SetLabels(const std::vector<int32_t>& labels, const std::vector<ClassSmoothness>& classes, double mixed);

  // Reweights all vertices by how the surface at `v` bends: one step of iteratively reweighted least squares. Counts
  // from SetLabels; without labels there is one class, and its weights stay. Not thread-safe.
  void Reweight(const Positions& v, const CreaseWeights& creases);

  double Energy(const Positions& v, const SmoothWeights& weights) const;
  // Smoothing steps before Reweight looks.
  static constexpr int kCreaseSteps = 3;
  static constexpr double kCreaseShrinks = 0.19 / 0.41;
  // Of vertices, that a derivative and a block of the system depend on: a neighbour's row takes in its neighbours, its
  // weights their faces, and as many rings about it as Reweight looks at: the smoothing steps' and its umbrella's.
  // (Within r rings: the faces that have a corner within r - 1.)
  static constexpr int kGradientRings = 1 + kCreaseSteps + 1;
  // Overwrites `gradient` with dE/dv; zero at fixed vertices.
  void Gradient(const Positions& v, const SmoothWeights& weights, Positions* gradient) const;

  // Approximately solves (data + A + inter) step = rhs by `sweeps` of the block-Jacobi-preconditioned Chebyshev
  // iteration from zero, in single precision. What a vertex gets depends on `data` and `rhs` within SolveRings, and on
  // topology and labels within kGradientRings of those.
  // `data`: one symmetric positive semidefinite 3x3 block a vertex; `inter`: of the same mesh, or null. Steps of fixed
  // vertices are zero, as are those that are not active. The iteration never diverges, whatever the weights.
  void SolveStep(const std::vector<Eigen::Matrix3d>& data, const Positions& rhs, const SmoothWeights& weights,
                 int sweeps, Positions* step, const InterCurvature* inter = nullptr) const;

  // The first sweep reads the vertex's own right-hand side; each after it multiplies with A, which has two rings: rows
  // of the umbrella and their transposes, rows along rims, and corners of E_inter, whose three vertices are neighbours.
  static constexpr int SolveRings(int sweeps) { return sweeps > 1 ? 2 * (sweeps - 1) : 0; }

  bool on_rim(size_t vertex) const { return rings_.rim[vertex] != 0; }

 private:
  // The topology in an order that keeps neighbours close in memory, for SolveStep.
  struct Layout;
  // One system of SolveStep.
  class System;
  // What SolveStep needs of a vertex's topology and labels, for weights of one.
  struct Diagonals {
    float inverse_degree = 0;
    float factor = 0;  // of the vertex's umbrella; zero on rims
    float plate = 0;   // diagonals of A
    float slack = 1;   // by which plate is multiplied so that the preconditioner bounds A whatever the degrees:
                       // ‖x_v - mean‖² ≤ 2 ‖x_v‖² + 2 mean ‖x_w‖²
    float membrane = 0;
    float rim = 0;
    bool special = false;  // on a rim or of mixed labels
  };
  struct KeptVertex {
    uint32_t vertex;
    Eigen::Matrix3d block;  // mean of keep(f) n_f n_fᵀ
  };
  void MakeLayout(const std::vector<uint8_t>& active);
  void FindDiagonals();
  bool has_rim_row(size_t v) const { return rings_.along_rim[v][0] != rings_.along_rim[v][1] && !fixed_[v]; }
  // U v inside the surface, U d along rims.
  void Umbrella(const Positions& v, Positions* rows) const;
  // |n·U v| over the mean length of edges, of vertices inside the surface; of others 0.
  std::vector<double> Bends(const Positions& v) const;
  // Weight of an edge inside the surface.
  double EdgeFactor(uint32_t v, uint32_t w) const { return mixed_[v] ? factor_[w] : factor_[v]; }

  Positions start_;
  std::vector<Triangle> faces_;
  std::vector<uint8_t> fixed_;
  OneRings rings_;
  std::vector<double> class_factor_;  // ω of a vertex, `mixed` included; empty: no labels
  std::vector<double> factor_;        // the same, reweighted
  std::vector<uint8_t> mixed_;        // its faces have several labels
  std::vector<KeptVertex> kept_;      // by rising number
  std::vector<Diagonals> diagonals_;  // by Layout's places
  std::shared_ptr<const Layout> layout_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_SMOOTH_TERM_H_
