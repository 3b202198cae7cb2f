// E_intra: thin-plate energy by the umbrella operator with one weight per class, and a membrane part (Bláha et al.
// 2017, section 3.1).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "common/geometry/mesh.h"
#include "worker/refine/one_rings.h"
#include "worker/refine/start_surface.h"

namespace tessera {

struct InterCurvature;

// Smoothness of a class, relative to SmoothWeights.
struct ClassSmoothness {
  double smoothness = 1;  // ω: factor of thin plate and membrane
  double anchor = 0;      // anchor weight: factor of SmoothWeights::anchor for the start's faces of this class
};

struct SmoothWeights {
  double thin_plate = 1;  // of ½ Σ ω(v) ‖(U v)_k‖² over interior vertices, U v = v - mean of the one-ring
  double membrane = 0;  // of ½ Σ ω(edge) ‖v_a - v_b‖²/6 over edges with two faces, not both ends on the boundary
  double boundary = 0;  // of ½ Σ ‖(U d)_k‖² along the boundary, d = v - start: smooths the motion, not the shape
  double anchor = 1;    // anchor, of ½ Σ_k mean over the faces f at k of anchor(f) (n_f · (v_k - start_k))²
};

// Reduces smoothing at creases and increases it on flat surfaces. A vertex's weight of thin plate and membrane is
// multiplied by flat / (1 + s / (1 + rough max(0, r - s))), where s = (b / bend)² and b is the bend |n·U v| divided
// by the mean edge length, on the surface after kCreaseSteps smoothing steps, which remove most noise.
// A right-angled crease along regular edges has b = .41 before and .19 after these steps (ratio kCreaseShrinks). A
// bend that shrinks by more is noise or finer detail: r is the s that such a crease would have, given the bend
// before. Noise shrinks to .10 to .15 of its bend; creases that cut across faces to .35 to .40, so their weights are
// reduced less.
struct CreaseWeights {
  double bend = 0;   // 0: off, weights are unchanged
  double flat = 1;   // >= 0
  double rough = 0;  // >= 0; 0: every bend counts as a crease
};

// The quadratic form E(v) = ½ ⟨v, A v⟩ - ⟨c, v⟩ + const for one mesh topology. Fixed vertices contribute but have no
// derivative. Const members are thread-safe; results do not depend on the number of threads.
class SmoothTerm {
 public:
  using Positions = std::vector<Eigen::Vector3d>;

  // `fixed`: flags of boundary and frozen vertices, one per vertex or empty. Mesh boundaries at fixed vertices get no
  // terms. One class of weight 1 until SetLabels; labels of `start` are ignored.
  // `active`: flags of the vertices whose steps SolveStep computes; empty: all.
  SmoothTerm(const StartSurface& start, const std::vector<uint8_t>& fixed, const std::vector<uint8_t>& active = {});

  // `labels`: one per face (-1 or 255: unlabelled, a class of its own with weight 1), or empty: one class of weight
  // 1. Classes beyond the end of `classes` have weight 1. Vertices whose faces have several labels get weight `mixed`
  // (0: none), as do edges between two of them. Linear time; may be called repeatedly.
  void SetLabels(const std::vector<int32_t>& labels, const std::vector<ClassSmoothness>& classes, double mixed);

  // Recomputes the weights of all vertices from the creases of the surface at `v`: one step of iteratively reweighted
  // least squares, relative to the weights of SetLabels. Without labels nothing changes. Not thread-safe.
  void Reweight(const Positions& v, const CreaseWeights& creases);

  double Energy(const Positions& v, const SmoothWeights& weights) const;
  // Smoothing steps before Reweight measures bends.
  static constexpr int kCreaseSteps = 3;
  static constexpr double kCreaseShrinks = 0.19 / 0.41;
  // Dependency radius of a derivative and of a diagonal block in rings: a neighbour's row includes its neighbours,
  // its weight their faces, plus the rings of Reweight's smoothing steps and umbrella. (Within r rings: faces that
  // have a corner within r - 1.)
  static constexpr int kGradientRings = 1 + kCreaseSteps + 1;
  // Overwrites `gradient` with dE/dv; zero at fixed vertices.
  void Gradient(const Positions& v, const SmoothWeights& weights, Positions* gradient) const;

  // Approximately solves (data + A + inter) step = rhs by `sweeps` of Chebyshev iteration with a block-Jacobi
  // preconditioner, from zero, in single precision. A vertex's result depends on `data` and `rhs` within SolveRings,
  // and on topology and labels within kGradientRings of those.
  // `data`: one symmetric positive semidefinite 3x3 block per vertex. `inter`: of the same mesh, or null. Steps of
  // fixed and of inactive vertices are zero. The iteration cannot diverge, for any weights.
  void SolveStep(const std::vector<Eigen::Matrix3d>& data, const Positions& rhs, const SmoothWeights& weights,
                 int sweeps, Positions* step, const InterCurvature* inter = nullptr) const;

  // The first sweep reads only the vertex's own right-hand side. Each further sweep multiplies by A, which couples
  // two rings: rows of the umbrella and their transposes, rows along boundaries, and corners of E_inter, whose three
  // vertices are neighbours.
  static constexpr int SolveRings(int sweeps) { return sweeps > 1 ? 2 * (sweeps - 1) : 0; }

  bool on_boundary(size_t vertex) const { return rings_.on_boundary[vertex] != 0; }

 private:
  // The topology in an order of good memory locality, for SolveStep.
  struct Layout;
  // The system of one call of SolveStep.
  class System;
  // Per-vertex data of SolveStep derived from topology and labels, for unit weights.
  struct Diagonals {
    float inverse_degree = 0;
    float factor = 0;  // of the vertex's umbrella; zero on boundaries
    float plate = 0;   // diagonals of A
    // Factor of plate that makes the preconditioner an upper bound of A for any degrees, since ‖x_v - mean‖² ≤
    // 2 ‖x_v‖² + 2 mean ‖x_w‖².
    float slack = 1;
    float membrane = 0;
    float boundary = 0;
    bool special = false;  // on a boundary or with mixed labels
  };
  struct AnchoredVertex {
    uint32_t vertex;
    Eigen::Matrix3d block;  // mean of anchor(f) n_f n_fᵀ
  };
  void MakeLayout(const std::vector<uint8_t>& active);
  void FindDiagonals();
  bool has_boundary_row(size_t v) const {
    return rings_.along_boundary[v][0] != rings_.along_boundary[v][1] && !fixed_[v];
  }
  // U v inside the surface, U d along boundaries.
  void Umbrella(const Positions& v, Positions* rows) const;
  // |n·U v| over the mean edge length; 0 on boundaries.
  std::vector<double> Bends(const Positions& v) const;
  // Weight of an edge with two faces.
  double EdgeFactor(uint32_t v, uint32_t w) const { return mixed_[v] ? factor_[w] : factor_[v]; }

  StartSurface surface_;
  const Positions& start_;
  const std::vector<Triangle>& faces_;
  const CsrRows& faces_of_vertex_;
  std::vector<uint8_t> fixed_;
  OneRings rings_;
  std::vector<double> class_factor_;      // ω of each vertex, including `mixed`; empty: no labels
  std::vector<double> factor_;            // the same, after Reweight
  std::vector<uint8_t> mixed_;            // flags of vertices whose faces have several labels
  std::vector<AnchoredVertex> anchored_;  // ascending by vertex
  std::vector<Diagonals> diagonals_;      // in Layout's order
  std::shared_ptr<const Layout> layout_;
};

}  // namespace tessera
