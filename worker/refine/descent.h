// One step of the descent: data and smoothness balanced vertex by vertex, bounded, and kept from folding faces.
#ifndef TESSERA_WORKER_REFINE_DESCENT_H_
#define TESSERA_WORKER_REFINE_DESCENT_H_

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/geometry/topology.h"
#include "worker/refine/inter_term.h"
#include "worker/refine/photo_term.h"
#include "worker/refine/smooth_term.h"

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

// Holds steps against the start of the run. What it does to a vertex depends on few rings about it. Thread-safe.
class MotionGuard {
 public:
  using Positions = std::vector<Eigen::Vector3d>;

  // `fixed`: one flag a vertex or empty. The mesh need not be a manifold.
  MotionGuard(const TriangleMesh& start, const std::vector<uint8_t>& fixed, const MotionLimits& limits);

  // Brakes what would leave the vertices' ellipsoids. Steps are only shortened.
  void LimitDisplacement(const Positions& at, Positions* step) const;

  // Changes `step` at the corners of faces whose normals would turn by more than `min_turn_cosine` allows, whose area
  // would collapse, or that would turn against the smoothed start: made alike over the face, then halved, in the end
  // dropped. No step becomes longer than the longest about it.
  void LimitFolding(const TriangleMesh& mesh, double min_turn_cosine, Positions* step) const;

  // Whether the face, as it lies in `to`, keeps to min_start_cosine, or did not in `from` and got no worse.
  bool KeepsFacing(uint32_t face, const Positions& from, const Positions& to) const;

  // The start with the faces that face less than min_start_cosine allows put where the smoothed start has them: such
  // slivers would else stay as they are.
  Positions UnfoldedStart() const;

  // Faces whose normals point against the smoothed start's.
  int64_t TurnedFaces(const Positions& at) const;

  const IndexRows& faces_of_vertex() const { return faces_of_vertex_; }
  const std::vector<Eigen::Vector3f>& start_normals() const { return start_normals_; }  // a face, smoothed
  Eigen::Vector3d start_normal(size_t vertex) const { return vertex_normals_[vertex].cast<double>(); }  // smoothed

 private:
  Eigen::Vector3d Braked(size_t vertex, const Eigen::Vector3d& at, const Eigen::Vector3d& step) const;

  MotionLimits limits_;
  std::vector<uint8_t> fixed_;
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

struct StepOptions {
  SmoothWeights weights;  // per metre²
  double inter = 0;       // λ3
  int smoothing_sweeps = 10;
  double grid_m = 0;  // positions after the step are multiples of it but where faces fold; a power of two; 0: any
  double max_step_m = 0;
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  double min_turn_cosine = 0.4;  // a face's normal turns by less than this angle's arc cosine in a step
};

// The Gauss-Newton step of data and smoothness terms at `mesh`: (curvatures + A) step = -(gradients), every vertex's
// length bounded, and what `guard` makes of it. Rims of level surfaces keep their place in plan. Depends on no sum over
// the mesh. Zero at fixed vertices.
std::vector<Eigen::Vector3d> ComputeStep(const TriangleMesh& mesh, const PhotoDerivatives& photo,
                                         const SmoothTerm& smooth, const InterTerm& inter, const MotionGuard& guard,
                                         const StepOptions& options);

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_DESCENT_H_
