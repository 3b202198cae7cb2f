// One step of the descent: data and smoothness balanced vertex by vertex, bounded, and kept from folding faces.
#ifndef TESSERA_WORKER_REFINE_DESCENT_H_
#define TESSERA_WORKER_REFINE_DESCENT_H_

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/geometry/csr_rows.h"
#include "common/geometry/mesh.h"
#include "worker/refine/inter_term.h"
#include "worker/refine/smooth_term.h"
#include "worker/refine/vertex_sums.h"

namespace tessera {

// How far a run may take a surface from its start, in all its steps together.
struct MotionLimits {
  // Half axes of the ellipsoid about each vertex's start that it stays in, along the smoothed start's normal and
  // across it. From `free_share` of it on outward motion is braked.
  double max_normal_m = std::numeric_limits<double>::infinity();
  double max_tangent_m = std::numeric_limits<double>::infinity();
  double free_share = 0.5;
  // Of a face's normal and the same face's in the smoothed start. A face that starts below may not get worse.
  double min_start_cosine = 0.02;
  int start_smoothing_steps = 5;  // of half an umbrella step each; rims and fixed vertices stay
};

// No vertex that starts at its place and takes steps that a MotionGuard let through, whole or in part, is ever farther
// from its start. Proof: the start is the ellipsoid's centre. Braked() and UnfoldedStart() end in the ellipsoid;
// LimitFolding() shortens or brakes; ComputeStep() rounds to the grid only inside it; FoldRepair ends between two
// places in it, and an ellipsoid is convex. The half axes grow by a millionth, for the rounding of floats.
double MotionBound_m(const MotionLimits& limits);

// Flags of vertices that have either; empty ones are none.
std::vector<uint8_t> EitherFlag(std::vector<uint8_t> a, const std::vector<uint8_t>& b);

// Holds steps against the start of the run. Thread-safe.
class MotionGuard {
 public:
  using Positions = std::vector<Eigen::Vector3d>;

  // `boundary`, `frozen`: flags of vertices that do not move, one a vertex or empty. Only boundary vertices keep their
  // place in the smoothed start. The mesh need not be a manifold.
  MotionGuard(const TriangleMesh& start, const std::vector<uint8_t>& boundary, const MotionLimits& limits,
              const std::vector<uint8_t>& frozen = {});

  // Brakes what would leave the vertices' ellipsoids. Steps are only shortened.
  void LimitDisplacement(const Positions& at, Positions* step) const;

  // Passes of LimitFolding: steps are made alike over folding faces, which turns nothing and keeps the faces' way, then
  // halved. Of 428,000 faces 5,000 fold by a wide step before them and 80 after, by a narrow one 150 and hardly any.
  // (Dropping steps at once helps less: beside neighbours that go on, other faces fold.)
  static constexpr int kLevellings = 4, kHalvings = 8;
  static constexpr int kFoldingPasses = kLevellings + kHalvings;

  // Changes `step` at the corners of faces whose normals would turn by more than `min_turn_cosine` allows, whose area
  // would collapse, or that would turn against the smoothed start. No step becomes longer than the longest about it. A
  // pass changes a vertex by what its own faces do, so that it depends on kFoldingPasses rings. What still folds then
  // stays so; FoldRepair takes it back if it turned against the start.
  void LimitFolding(const TriangleMesh& mesh, double min_turn_cosine, Positions* step) const;

  // Whether the face, as it lies in `to`, keeps to min_start_cosine, or did not in `from` and got no worse. Reads the
  // face's corners, and the start within start_smoothing_steps rings of them.
  bool KeepsFacing(uint32_t face, const Positions& from, const Positions& to) const;

  // The start with the faces that face less than min_start_cosine allows put where the smoothed start has them, or as
  // far towards there as a step may lead: such slivers would else stay as they are.
  Positions UnfoldedStart() const;

  // Whether `at` lies in the vertex's ellipsoid.
  bool Contains(size_t vertex, const Eigen::Vector3d& at) const;

  // Faces whose normals point against the smoothed start's.
  int64_t TurnedFaces(const Positions& at) const;

  const IndexRows& faces_of_vertex() const { return faces_of_vertex_; }
  const std::vector<Eigen::Vector3f>& start_normals() const { return start_normals_; }  // a face, smoothed
  Eigen::Vector3d start_normal(size_t vertex) const { return vertex_normals_[vertex].cast<double>(); }  // smoothed

 private:
  Eigen::Vector3d Braked(size_t vertex, const Eigen::Vector3d& at, const Eigen::Vector3d& step) const;
  // A distance from the start in the frame that makes the vertex's ellipsoid a unit ball.
  Eigen::Vector3d InBall(size_t vertex, const Eigen::Vector3d& from_start) const;

  MotionLimits limits_;
  std::vector<uint8_t> fixed_;  // boundary or frozen
  std::vector<Triangle> faces_;
  IndexRows faces_of_vertex_;
  Positions start_, smoothed_;
  std::vector<Eigen::Vector3f> start_normals_;   // a face
  std::vector<Eigen::Vector3f> vertex_normals_;  // of the smoothed start
};

// The faces of each vertex, ascending.
IndexRows FacesOfVertices(const TriangleMesh& mesh);

// The mesh after `steps` umbrella steps of half the way each: steps of its stairs become slopes. Rims and vertices with
// a flag in `fixed` (may be empty) stay.
std::vector<Eigen::Vector3d> SmoothedPositions(const TriangleMesh& mesh, const IndexRows& faces_of_vertex,
                                               const std::vector<uint8_t>& fixed, int steps);

// What a vertex's step depends on: the vertices within so many rings of it (that at most so many edges lead to), their
// flags and start, and the faces that have a corner within one ring less, with their labels.
struct StepReach {
  int gradient = 0;  // of smooth and inter terms; also the blocks of their system and the edges' weights
  int sweeps = 0;    // how far SolveStep carries a right-hand side
  int start = 0;     // the smoothed start's normal at a vertex, for rims and ellipsoids
  int folding = 0;   // LimitFolding

  // LimitFolding reads steps that were solved and braked; its faces' start normals reach a ring less than those at
  // vertices.
  int rings() const { return folding + std::max(gradient + sweeps, start); }
};

// The curvatures bound the terms' own from above, so steps are safe and short. Where images say something, a step is
// made longer and part of the step before is added (momentum, Polyak 1964): by the share e/(e + evidence) of the data's
// curvature e at the vertex, so that there is no momentum where only smoothness acts (beyond rims, behind crowns).
struct Acceleration {
  double relaxation = 1;  // what a step is multiplied by, >= 1
  double momentum = 0;    // share of the step before that is added, [0, 1)
};

struct StepOptions {
  SmoothWeights weights;  // per metre²
  double inter = 0;       // λ3
  int smoothing_sweeps = 10;
  double grid_m = 0;  // positions after the step are multiples of it but where faces fold or the ellipsoid ends; a
                      // power of two; 0: any
  double max_step_m = 0;
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  double min_turn_cosine = 0.4;  // a face's normal turns by less than this angle's arc cosine in a step
  Acceleration acceleration;
  double evidence = 0;  // per metre²: the data's curvature at which half of the acceleration is had
};

StepReach StepReachOf(const StepOptions& options, const MotionLimits& limits);

// The Gauss-Newton step of data and smoothness terms at `mesh`: (curvatures + A) step = -(gradients), accelerated with
// `last`, what the iteration before added (empty: none), every vertex's length bounded, and what `guard` makes of it.
// Rims of level surfaces keep their place in plan. Zero at fixed vertices. A vertex's step depends on StepReachOf's
// rings about it, to the last bit; of the order of vertices and faces only on which of two comes first, so that a part
// of a mesh that keeps the order gives the bytes of the whole.
std::vector<Eigen::Vector3d> ComputeStep(const TriangleMesh& mesh, const PhotoDerivatives& photo,
                                         const SmoothTerm& smooth, const InterTerm& inter, const MotionGuard& guard,
                                         const StepOptions& options, const std::vector<Eigen::Vector3f>& last = {});

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_DESCENT_H_
