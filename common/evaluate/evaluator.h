// Evaluation of a mesh against ground truth: geometry and labels.
//
// Definition of the figures:
// - `samples` points are drawn uniformly by area on the mesh (accuracy) and on the truth (completeness), with a fixed
//   seed.
// - A point is used if at least `min_views` cameras see it (ray-tested against its own surface, SeenSamples), and if it
//   lies at least `rim_m` inside the truth's bounding box in the horizontal plane.
// - Its distance is the exact distance to the nearest triangle of the other surface, whether visible or not.
// - Its class is the truth's: that of its own face or of the nearest face of the truth.
// - Labels by area: each used point of the truth is compared with the label of the mesh's nearest face.
// - Labels by pixels: the mesh is rendered into every view with a truth image, one ray per pixel, and compared with
// that
//   image. Pixels with truth 255 are ignored; pixels where no label is rendered are errors. Bláha et al. 2017,
//   section 4.
#pragma once

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
  Eigen::Vector3d up_in_local = Eigen::Vector3d::UnitZ();  // unit vector
};

struct LabelEvaluation {
  ConfusionMatrix confusion;
  LabelScores scores;
};

struct PixelLabelEvaluation : LabelEvaluation {
  int views = 0;  // number of views with a truth image
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

// The truth image of views[view] as stored (distorted, class ids, 255: unknown); empty if the view has none.
using TruthLabelSource = std::function<StatusOr<LabelImage>(size_t view)>;

// Evaluates several meshes against one truth; keeps the truth's search tree and its used points. Results do not depend
// on the number of threads.
class Evaluator {
 public:
  // `truth` and `views` are in the same local frame. `classes`: at most 254. FAILED_PRECONDITION if no point of the
  // truth can be used.
  static StatusOr<Evaluator> Create(TriangleMesh truth, std::vector<SceneView> views, int classes,
                                    TruthLabelSource truth_labels, EvaluationOptions options);
  ~Evaluator();
  Evaluator(Evaluator&&) noexcept;
  Evaluator& operator=(Evaluator&&) noexcept;

  // `mesh` is in the same frame. INVALID_ARGUMENT if it has no faces, or if one of its labels or of a truth image's is
  // not below the number of classes; errors of the truth label source.
  StatusOr<Evaluation> Evaluate(const TriangleMesh& mesh) const;

 private:
  struct Impl;
  explicit Evaluator(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
