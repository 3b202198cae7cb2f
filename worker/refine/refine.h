// The geometry step: moves a mesh's vertices so that the images agree, topology fixed (Vu et al. 2012; Bláha et al.
// 2017, sections 2 and 3.1), from coarse to fine over an image pyramid.
#ifndef TESSERA_WORKER_REFINE_REFINE_H_
#define TESSERA_WORKER_REFINE_REFINE_H_

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"
#include "worker/refine/pairs.h"
#include "worker/refine/smooth_term.h"
#include "worker/refine/view_pixels.h"
#include "worker/refine/warp_target.h"
#include "worker/visibility/view_groups.h"

namespace tessera {

struct RefineView {
  PosedCamera camera;                        // of the whole image
  std::shared_ptr<const ViewPixels> pixels;  // of part of it; read at the beginning of each level
  bool asks_likelihoods = true;              // where the options do and the pixels have them
  PixelMapping mapping = {};                 // from the whole image to likelihoods
  int x0 = 0, y0 = 0;                        // of the luminance's first pixel in the whole image
  DepthRange depths = {};                    // of all that the job looks at in the view; empty: of the mesh as it lies
};

// Everything in one metric frame.
struct RefineProblem {
  TriangleMesh mesh;  // oriented; already split (SplitLargeFaces); labels choose the class weights
  // Where the vertices began, if earlier rounds or parts moved them: bounds on motion and folds count from there.
  // Empty: `mesh`.
  std::vector<Eigen::Vector3d> start;
  std::vector<uint8_t> fixed_vertices;  // 1: stays where it is (tile cuts); empty: none
  TriangleMesh occluders;               // hides, but is not refined; may be empty
  std::vector<RefineView> views;
  double reach_m = std::numeric_limits<double>::infinity();  // across `up`: what is farther off is known less well
  ViewGroups groups;                                         // of the mesh's faces and `views`
  double gsd_m = 0;                                          // the job's median ground sampling distance
  std::vector<ViewPair> pairs;  // ordered, sorted by reference; empty: chosen here (SelectPairs)
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
};

struct RefineOptions {
  // The pyramid, coarsest first: level l halves the images l times.
  std::vector<int> levels = {2, 1, 0};
  std::vector<int> iterations = {3, 10, 10};  // one entry a level

  // Windowed ZNCC.
  int window_px = 7;            // odd, 3..11
  bool gaussian_window = true;  // sigma = window_px / 4; else a box
  double noise_sigma = 0.01;    // of luminance: a reference window of variance v weighs v / (v + sigma²)
  double min_sigma = 0.004;     // windows of less standard deviation in either image are rejected
  double max_mean_difference = 0.3;
  double max_variance_ratio = 10;
  double min_valid = 0.5;      // share of a window that both images must see
  double min_cosine = 0.1;     // flatter views of a face than this are skipped
  int silhouette_px = 16;      // how near far silhouettes nothing is compared, pixels of level 0; a window's at least
  double occlusion_px = 1;     // slack of the depth test, in pixels of the level
  double photo_outlier = 0.5;  // s: a window's e = 1 - ZNCC counts e / (1 + e/s)

  // E_sem.
  double semantic = 0;                                                // λ1; 0: off
  double semantic_outlier = std::numeric_limits<double>::infinity();  // as photo_outlier, for e = ½ Σ_l ΔL² of a pixel

  double contour = 0;  // λ4, of E_contour; 0: off

  // Smoothness, per vertex, relative to the mean pair's photo energy summed over pixels of the level; displacements
  // count in pixels of the level.
  double thin_plate = 0.3;  // λ2
  double membrane = 0.02;
  double rim = 0.3;                      // keeps the displacement of mesh rims smooth along the rim
  double tangential = 1;                 // of the thin plate within the surface (SmoothWeights)
  std::vector<ClassSmoothness> classes;  // by label; beyond its end: weight 1
  double mixed = 0.3;                    // weight of vertices whose faces have several labels; 0: none
  double inter = 0;                      // λ3, of E_inter; 0: off
  int smoothing_sweeps = 20;             // Chebyshev sweeps of the semi-implicit step

  // Descent.
  double max_step_px = 1.0;  // per iteration, pixels of the level
  double step_decay = 0.9;   // of the step cap per iteration
  // Steps end on a grid of (at most) so much: the solver carries what happens at a tile's cut far, in ever smaller
  // differences, which all are gone beyond where they are less than that.
  double grid_gsd = 0.016;
  double max_normal_gsd = 32, max_tangent_gsd = 24;  // of a whole run, along the smoothed start's normal and across
  int start_smoothing_steps = 5;                     // what of the start counts as shape (SmoothedPositions)
  double min_start_cosine = 0.02;                    // of a face's normal with the smoothed start's

  // Pairs.
  int partners = 4;  // that a view chooses (SelectPairs)
  double min_angle_deg = 2.5, max_angle_deg = 45, best_angle_deg = 15;

  std::string scratch_folder;    // takes the texels of views that are not looked at; empty: they are held
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
  int64_t repaired_vertices = 0;  // whose motion was taken back, all or in part, because faces folded or cut each other
  double seconds_prepare = 0, seconds_repair = 0, seconds_visibility = 0, seconds_photo = 0, seconds_step = 0;
  int64_t warped_pixels = 0;  // reference pixels x partners x evaluations
};

// Some of the iterations, counted over all levels, so that a tile can hear from its neighbours in between.
struct RefinePart {
  int begin = 0, end = std::numeric_limits<int>::max();  // of the iterations; `end` is cut to their number
  // Positions when the level of iteration `begin` began. Read if that is not the level's first; written, for the next
  // part, if the level of iteration `end` has begun, else emptied.
  std::vector<Eigen::Vector3d> level_start;
};

// Refines problem.mesh and writes the new positions to `vertices` (all of them, fixed ones unchanged). Nothing that is
// summed over the whole mesh steers a vertex: what happens to it depends on its surroundings alone, to the last bit, so
// that two meshes that overlap agree where both have the surroundings (with the same frame, depths and groups). The
// result does not depend on the number of threads. One part after the other, each from the positions of the last and
// with problem.start, gives the bytes of all at once. `part`: null for all. Errors: INVALID_ARGUMENT for a problem,
// options or part that do not fit together; CANCELLED; what reading pixels gives.
StatusOr<RefineReport> RefineGeometry(const RefineProblem& problem, std::vector<Eigen::Vector3d>* vertices,
                                      const RefineOptions& options, const TaskControl& control,
                                      RefinePart* part = nullptr);

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_REFINE_H_
