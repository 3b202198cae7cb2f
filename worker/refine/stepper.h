// Moves the vertices after the data term is evaluated: step, guard and repair, with the data of the start that they
// need.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/geometry/mesh.h"
#include "worker/refine/descent.h"
#include "worker/refine/inter_term.h"
#include "worker/refine/self_intersection.h"
#include "worker/refine/smooth_term.h"
#include "worker/refine/start_surface.h"
#include "worker/refine/vertex_sums.h"

namespace tessera {

struct StepperOptions {
  // Smoothness per vertex, relative to the photo energy of an average pair summed over pixels of the level.
  // Displacements count in pixels of the level.
  double thin_plate = 0.3;  // λ2
  double membrane = 0.02;
  double rim = 0.3;                      // smooths the motion of the mesh boundary along it
  std::vector<ClassSmoothness> classes;  // by label; classes beyond the end have weight 1
  double mixed = 0.3;                    // weight of vertices whose faces have several labels; 0: none
  CreaseWeights creases;                 // of vertices with labels
  double inter = 0;                      // λ3, of E_inter; 0: off
  int smoothing_sweeps = 20;             // Chebyshev sweeps of the semi-implicit step

  double max_step_px = 1.0;  // per iteration, pixels of the level
  double step_decay = 0.95;  // factor of the maximum step per iteration
  Acceleration acceleration = {1.5, 0.6};
  double half_effect_curvature =
      0.3;  // data curvature per vertex, in units of smoothness, at which the acceleration has half its effect
  double grid_gsd = 0.016;  // upper bound of the grid spacing on which steps end
  double max_normal_gsd = 32,
         max_tangent_gsd = 24;     // limits per run, along the smoothed start's normal and perpendicular to it
  int start_smoothing_steps = 5;   // smoothing of the start that defines its normals (SmoothedPositions)
  double min_start_cosine = 0.02;  // minimum between a face's normal and the smoothed start's
};

// The steps of one mesh. No sum over the whole mesh affects a vertex, so results depend only on its neighbourhood
// (StepDependencyRadiusOf) and not on the number of threads.
class Stepper {
 public:
  // `start`: positions before the first round; `labels`: as in SetLabels. Flags, one a vertex or empty for none:
  // `boundary`: some faces about the vertex are missing, so it does not move; `frozen`: does not move, but all its
  // faces are there. `active` (empty: all): vertices whose steps are right; those of others are unspecified.
  Stepper(const StartSurface& start, const std::vector<int32_t>& labels, const std::vector<uint8_t>& boundary,
          double gsd_m, const Eigen::Vector3d& up, const StepperOptions& options,
          const std::vector<uint8_t>& active = {}, const std::vector<uint8_t>& frozen = {});

  const MotionGuard& guard() const { return *guard_; }

  // Replaces the labels: one a face, or empty.
  void SetLabels(const std::vector<int32_t>& labels);

  // The step of iteration `iteration` (from 0) of a level, to be added to the positions `at`. `last`: the step of
  // the iteration before; empty or zeros at the first. Not thread-safe.
  std::vector<Eigen::Vector3d> Step(const std::vector<Eigen::Vector3d>& at, const PhotoDerivatives& derivatives,
                                    int level, int iteration, const std::vector<Eigen::Vector3f>& last);

  // Takes back the motion since `good` that turned faces or made them cut each other. Not thread-safe.
  SurfaceRepair::Result Repair(const std::vector<Eigen::Vector3d>& good, std::vector<Eigen::Vector3d>* positions);

 private:
  const StepperOptions options_;
  const double gsd_m_;
  const Eigen::Vector3d up_;
  const StartSurface start_;
  // Always there, but inter_ only if it has a weight; optional because they are created at the same time.
  std::optional<SmoothTerm> smooth_;
  std::optional<InterTerm> inter_;
  std::optional<MotionGuard> guard_;
  std::optional<SurfaceRepair> repair_;  // created on first use
};

// The motion limits of a run.
MotionLimits MakeMotionLimits(const StepperOptions& options, double gsd_m);

// The longest step that Stepper::Step returns for an iteration of a level, in metres. Proof: ComputeStep shortens steps
// to StepOptions::max_step_m. After that, LimitDisplacement shortens them, rounding to the grid adds at most half a
// diagonal of its cells, and LimitFolding shortens or averages them.
double LongestStep_m(const StepperOptions& options, double gsd_m, int level, int iteration);

}  // namespace tessera
