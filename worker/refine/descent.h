// One descent step: balances data and smoothness per vertex, limits the motion and prevents folds.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/geometry/csr_rows.h"
#include "common/geometry/mesh.h"
#include "worker/refine/inter_term.h"
#include "worker/refine/one_rings.h"
#include "worker/refine/smooth_term.h"
#include "worker/refine/start_surface.h"
#include "worker/refine/vertex_sums.h"

namespace tessera {

// Limits of the total motion of the surface from its start, over all steps of a run.
struct MotionLimits {
  // Semi-axes of an ellipsoid around each vertex's start position that the vertex never leaves, along the smoothed
  // start's normal and perpendicular to it. Outward motion is damped beyond `free_share` of it.
  double max_normal_m = std::numeric_limits<double>::infinity();
  double max_tangent_m = std::numeric_limits<double>::infinity();
  double free_share = 0.5;
  // Minimum cosine between a face's normal and its normal in the smoothed start. A face that starts below it must not
  // get worse.
  double min_start_cosine = 0.02;
  int start_smoothing_steps = 5;  // half umbrella steps; mesh boundary and `boundary` vertices stay
};

// Upper bound of a vertex's distance from its start after any number of steps that a MotionGuard passed, whole or in
// part. Proof: Braked() (see there for vertices of the second split) and RepairedStart() end inside the ellipsoid around
// the start; LimitFolding() shortens or damps steps; ComputeStep() rounds to the grid only inside it; SurfaceRepair
// interpolates between two positions inside it, and an ellipsoid is convex. Its axes are longer by 1e-6, for rounding.
double MotionBound_m(const MotionLimits& limits);

// Element-wise union of vertex flags. Empty: no flags.
std::vector<uint8_t> UnionOfFlags(std::vector<uint8_t> a, const std::vector<uint8_t>& b);

// Limits steps relative to the start of the run. Thread-safe.
class MotionGuard {
 public:
  using Positions = std::vector<Eigen::Vector3d>;

  // `boundary`, `frozen`: flags of vertices that do not move, one per vertex or empty. `boundary` vertices keep their
  // position in the smoothed start, `frozen` ones are smoothed. The mesh need not be manifold.
  MotionGuard(const StartSurface& start, const std::vector<uint8_t>& boundary, const MotionLimits& limits,
              const std::vector<uint8_t>& frozen = {});

  // Shortens steps that would leave the vertices' ellipsoids.
  void LimitDisplacement(const Positions& at, Positions* step) const;

  // Passes of LimitFolding. Smoothing passes average the steps over the corners of folding faces, which preserves
  // their common motion; then steps are halved. Example (428,000 faces): wide steps fold
  // 5,000 faces before these passes and 80 after; narrow steps 150 and nearly none. Setting steps to zero at once is
  // worse: next to vertices that still move, other faces fold.
  static constexpr int kSmoothingPasses = 4, kHalvings = 8;
  static constexpr int kFoldingPasses = kSmoothingPasses + kHalvings;

  // Shortens or averages `step` at the corners of faces whose normal would turn by more than `min_turn_cosine`
  // allows, whose area would collapse, or that would be inverted against the smoothed start. No step becomes longer
  // than the longest one around it. In each pass a vertex depends only on its own faces, hence on kFoldingPasses
  // rings in total. Faces that still fold afterwards are left; SurfaceRepair undoes the motion if they are inverted.
  void LimitFolding(const Positions& at, double min_turn_cosine, Positions* step) const;

  // Whether the face satisfies min_start_cosine in `to`, or did not in `from` and is no worse. Reads the face's
  // corners, and the start within start_smoothing_steps rings of them.
  bool KeepsOrientation(uint32_t face, const Positions& from, const Positions& to) const;

  // The start, in which faces below min_start_cosine get their smoothed positions, as far as a step may lead there.
  // Without this, such slivers would never improve.
  Positions RepairedStart() const;

  // Whether `at` lies in the vertex's ellipsoid.
  bool Contains(size_t vertex, const Eigen::Vector3d& at) const;

  // Number of faces whose normals are opposite to the smoothed start's.
  int64_t InvertedFaces(const Positions& at) const;

  const CsrRows& faces_of_vertex() const { return faces_of_vertex_; }
  const std::vector<Eigen::Vector3f>& start_normals() const { return start_normals_; }  // per face, smoothed
  Eigen::Vector3d start_normal(size_t vertex) const { return vertex_normals_[vertex].cast<double>(); }  // smoothed

 private:
  Eigen::Vector3d Braked(size_t vertex, const Eigen::Vector3d& at, const Eigen::Vector3d& step) const;
  // Maps an offset from the start so that the vertex's ellipsoid becomes the unit ball.
  Eigen::Vector3d InBall(size_t vertex, const Eigen::Vector3d& from_start) const;

  MotionLimits limits_;
  StartSurface surface_;
  const std::vector<Triangle>& faces_;
  const CsrRows& faces_of_vertex_;
  const Positions& start_;
  std::vector<uint8_t> fixed_;  // boundary or frozen
  Positions smoothed_;
  std::vector<Eigen::Vector3f> start_normals_;   // per face
  std::vector<Eigen::Vector3f> vertex_normals_;  // of the smoothed start
};

// Vertex positions after `steps` umbrella steps with factor ½, which smooth staircase artefacts. The mesh boundary
// and vertices with a flag in `fixed` (may be empty) stay.
std::vector<Eigen::Vector3d> SmoothedPositions(const TriangleMesh& mesh, const CsrRows& faces_of_vertex,
                                               const std::vector<uint8_t>& fixed, int steps);

// Dependency radius of a vertex's step, in rings (edges): it depends on the positions, flags and start of the
// vertices within the radius, and on the faces with a corner within one ring less, and their labels.
struct StepDependencyRadius {
  int gradient = 0;  // of the smooth and inter terms, including the diagonal blocks and edge weights
  int sweeps = 0;    // how far SolveStep propagates a right-hand side
  int start = 0;     // smoothed start's normal at a vertex, for boundaries and ellipsoids
  int folding = 0;   // LimitFolding

  // LimitFolding reads solved and damped steps. The start normals of its faces need one ring less than those of
  // vertices.
  int rings() const { return folding + std::max(gradient + sweeps, start); }
};

// Over-relaxation and heavy-ball momentum (Polyak 1964). Since the curvatures are upper bounds, plain steps are safe
// but short. Both effects are scaled by e/(e + half_effect_curvature) with the data's curvature e at the vertex, so
// there is no momentum where only smoothness acts (beyond the mesh boundary, behind tree crowns).
struct Acceleration {
  double relaxation = 1;  // factor of a step, >= 1
  double momentum = 0;    // share of the previous step that is added, [0, 1)
};

struct StepOptions {
  SmoothWeights weights;  // per metre²
  double inter = 0;       // λ3
  int smoothing_sweeps = 10;
  // Positions are rounded to multiples of grid_m, a power of two, except where faces fold or the ellipsoid ends; 0:
  // off.
  double grid_m = 0;
  double max_step_m = 0;
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  double min_turn_cosine = 0.4;  // lower bound of the cosine by which a face's normal turns in a step
  Acceleration acceleration;
  double half_effect_curvature = 0;  // per metre²: data curvature at which the acceleration has half its effect
};

StepDependencyRadius StepDependencyRadiusOf(int smoothing_sweeps, const MotionLimits& limits);

// The damped Gauss-Newton step of data and smoothness terms at the positions `at`: solves (curvatures + A) step =
// -(gradients), applies the acceleration with `last` (the previous iteration's step; empty: none), limits each vertex's
// length, and applies `guard`. `inter`: may be null if its weight is 0. Boundaries of horizontal surfaces keep their
// position in plan. Zero at fixed vertices. A vertex's step depends only on the rings given by StepDependencyRadiusOf,
// to the last bit. It depends on the order of vertices and faces only through their relative order, so a submesh that
// keeps the order gives the same bytes as the whole mesh.
std::vector<Eigen::Vector3d> ComputeStep(const std::vector<Eigen::Vector3d>& at, const PhotoDerivatives& photo,
                                         const SmoothTerm& smooth, const InterTerm* inter, const MotionGuard& guard,
                                         const StepOptions& options, const std::vector<Eigen::Vector3f>& last = {});

}  // namespace tessera
