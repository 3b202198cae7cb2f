// How good a mesh is, measured against the truth: geometry and labels.
//
// Definition, so that figures compare between tools and versions:
// - `samples` points are drawn by area on the mesh (accuracy) and on the truth (completeness) with a fixed seed.
// - A point counts if at least `min_views` cameras see it, ray-tested on the surface that it lies on (SeenSamples), and
//   if it lies at least `rim_m` inside the truth's bounding box in the horizontal plane.
// - Its distance is exact, from the point to the nearest triangle of the other surface, all of it, seen or not.
// - Its class is that of the truth: of the point itself, or of the truth's nearest face.
// - Labels by area: the truth's points that count against the label of the mesh's nearest face.
// - Labels by pixels: the mesh rendered into every view that has a truth image, one ray a pixel, against that image;
//   truth 255 is ignored, nothing rendered counts as wrong. As in Bláha et al. 2017, section 4.
#ifndef TESSERA_COMMON_EVALUATE_EVALUATOR_H_
#define TESSERA_COMMON_EVALUATE_EVALUATOR_H_

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "common/base/status.h"
#include "common/evaluate/boundary.h"
#include "common/evaluate/confusion.h"
#include "common/evaluate/surface_scores.h"
#include "common/geometry/mesh.h"
#include "common/imaging/raster.h"
#include "common/scene/scene.h"

namespace tessera {

struct EvaluationOptions {
  int64_t samples = 60000;
  uint64_t seed = 1;
  int min_views = 3;
  double rim_m = 0;
  double cap_m = 0.5;
  std::vector<double> f_distances_m = {0.05, 0.10, 0.20};
  int boundary_reach_px = 3;
  Eigen::Vector3d up_in_local = Eigen::Vector3d::UnitZ();  // unit
};

struct LabelEvaluation {
  ConfusionMatrix confusion;
  LabelScores scores;
};

struct PixelLabelEvaluation : LabelEvaluation {
  int views = 0;  // that have a truth image
  std::vector<BoundaryCounts> boundaries;
  double boundary_f = 0;
};

struct Evaluation {
  int64_t faces = 0;
  double area_m2 = 0;
  SurfaceScores surface;
  std::vector<SurfaceScores> surface_by_class;           // empty if the truth has no labels
  std::optional<LabelEvaluation> labels_by_area;         // if the mesh and the truth have labels
  std::optional<PixelLabelEvaluation> labels_by_pixels;  // if the mesh has labels and some view a truth image
};

// The truth image of views[view] as stored (own frame, class ids, 255: nothing), an empty one if it has none.
using TruthLabelSource = std::function<StatusOr<LabelImage>(size_t view)>;

// Holds the truth, its search trees and which of its points are seen, so that several meshes are measured alike.
// Results do not depend on the number of threads.
class Evaluator {
 public:
  // `truth` and `views` in one local frame. `classes` up to 254. Fails (FAILED_PRECONDITION) if no point of the truth
  // counts.
  static StatusOr<Evaluator> Create(TriangleMesh truth, std::vector<SceneView> views, int classes,
                                    TruthLabelSource truth_labels, EvaluationOptions options);
  ~Evaluator();
  Evaluator(Evaluator&&) noexcept;
  Evaluator& operator=(Evaluator&&) noexcept;

  // `mesh` in the same frame; its labels, if any, below the number of classes. INVALID_ARGUMENT if not, or if it has
  // no faces; the source's errors; INVALID_ARGUMENT if a truth image holds a class that there is not.
  StatusOr<Evaluation> Evaluate(const TriangleMesh& mesh) const;

 private:
  struct Impl;
  explicit Evaluator(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_EVALUATE_EVALUATOR_H_
