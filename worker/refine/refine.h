// The geometry step: moves a mesh's vertices so that the images agree, topology fixed (Vu et al. 2012; Bláha et al.
// 2017, sections 2 and 3.1), from coarse to fine over an image pyramid.
#ifndef TESSERA_WORKER_REFINE_REFINE_H_
#define TESSERA_WORKER_REFINE_REFINE_H_

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/geometry/mesh.h"
#include "worker/photo/data_term.h"
#include "worker/photo/pairs.h"
#include "worker/refine/stepper.h"
#include "worker/visibility/mesh_cells.h"
#include "worker/visibility/view_groups.h"

namespace tessera {

// Everything in one metric frame.
struct RefineProblem {
  TriangleMesh mesh;  // oriented; already split (SplitLargeFaces); labels choose the class weights
  // Where the vertices began, if earlier rounds moved them: bounds on motion and folds count from there. Empty: `mesh`.
  std::vector<Eigen::Vector3d> start;
  std::vector<uint8_t> fixed_vertices;  // 1: stays where it is; empty: none
  MeshCells cells;                      // of `mesh`; empty: it is drawn whole
  std::vector<RefineView> views;
  ViewGroups groups;            // of the mesh's faces and `views`
  double gsd_m = 0;             // the job's median ground sampling distance
  std::vector<ViewPair> pairs;  // ordered, sorted by reference; empty: chosen here (SelectPairs)
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
};

struct RefineOptions : DataOptions, StepperOptions {
  // The pyramid, coarsest first: level l halves the images l times.
  std::vector<int> levels = {2, 1, 0};
  std::vector<int> iterations = {3, 10, 10};  // one entry a level

  // Pairs.
  int partners = 4;  // that a view chooses (SelectPairs)
  double min_angle_deg = 2.5, max_angle_deg = 45, best_angle_deg = 15;

  const Clock* clock = nullptr;  // for the seconds of the report; null: they stay zero
};

// What one iteration saw before its step.
struct RefineIteration {
  int level = 0;
  double energy = 0;           // mean of e / (1 + e/photo_outlier), e = 1 - ZNCC, over accepted windows, weighted
  double semantic_energy = 0;  // mean E_sem over the pixels that have it
  double moved_px = 0;         // RMS over free vertices, pixels of the level
  int64_t pair_pixels = 0;     // accepted windows
};

struct RefineReport {
  double moved_rms_m = 0, moved_max_m = 0;  // since RefineProblem::start
  int pairs = 0;                            // ordered pairs
  std::vector<RefineIteration> iterations;
  int64_t left_faces = 0;         // that still cut each other or face wrongly after the repairs
  int64_t repaired_vertices = 0;  // whose motion was taken back, all or in part, because faces folded or cut each other
  double seconds_prepare = 0, seconds_repair = 0, seconds_visibility = 0, seconds_photo = 0, seconds_step = 0;
  int64_t warped_pixels = 0;  // reference pixels x partners x evaluations
};

// Refines problem.mesh and writes the new positions to `vertices` (all of them, fixed ones unchanged). Nothing that is
// summed over the whole mesh steers a vertex: what happens to it depends on its surroundings alone, to the last bit, so
// that two meshes that overlap agree where both have the surroundings (with the same frame, depths and groups). The
// result does not depend on the number of threads. Errors: INVALID_ARGUMENT for a problem or options that do not fit
// together; CANCELLED; what reading pixels gives.
StatusOr<RefineReport> RefineGeometry(const RefineProblem& problem, std::vector<Eigen::Vector3d>* vertices,
                                      const RefineOptions& options, const TaskControl& control);

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_REFINE_H_
