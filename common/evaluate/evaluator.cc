#include "common/evaluate/evaluator.h"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "common/base/parallel.h"
#include "common/evaluate/label_rendering.h"
#include "common/evaluate/surface_samples.h"
#include "common/geometry/nearest_surface.h"
#include "common/geometry/ray_caster.h"

namespace tessera {
namespace {

int LabelOf(const TriangleMesh& mesh, int64_t face) { return mesh.labels.empty() || face < 0 ? -1 : mesh.labels[face]; }

Status CheckLabels(const TriangleMesh& mesh, int classes, const std::string& what) {
  for (size_t f = 0; f < mesh.labels.size(); ++f) {
    if (mesh.labels[f] >= classes || mesh.labels[f] < -1) {
      return InputError(what, "faces[" + std::to_string(f) + "]", "label " + std::to_string(mesh.labels[f]),
                        "a class below " + std::to_string(classes) + ", or -1 for no label");
    }
  }
  return absl::OkStatus();
}

// The truth's bounding box in the horizontal plane, shrunk by `rim_m` on each side.
struct HorizontalBox {
  Eigen::Matrix3d level_from_local = Eigen::Matrix3d::Identity();
  Eigen::AlignedBox2d box;

  HorizontalBox(const TriangleMesh& mesh, const Eigen::Vector3d& up, double rim_m) {
    level_from_local = Eigen::Quaterniond::FromTwoVectors(up, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    for (const Triangle& face : mesh.faces) {
      for (uint32_t v : face) box.extend(Eigen::Vector2d((level_from_local * mesh.vertices[v]).head<2>()));
    }
    box.min().array() += rim_m;
    box.max().array() -= rim_m;
  }

  bool Contains(const Eigen::Vector3d& point) const {
    return box.contains(Eigen::Vector2d((level_from_local * point).head<2>()));
  }
};

struct Measured {
  std::vector<MeasuredPoint> points;
  std::vector<int64_t> nearest_face;
};

// Measures `samples` on `mesh` against `other`. The caller sets `truth_class` of each point.
Measured Measure(const std::vector<SurfaceSample>& samples, const TriangleMesh& mesh, const TriangleMesh& other,
                 const NearestSurface& other_surface) {
  Measured measured;
  measured.points.resize(samples.size());
  measured.nearest_face.resize(samples.size());
  ParallelForEach(samples.size(), 256, [&](size_t i) {
    const NearestPoint nearest = other_surface.Find(samples[i].point);
    measured.nearest_face[i] = nearest.face;
    measured.points[i].distance_m = nearest.distance_m;
    measured.points[i].normal_agreement =
        std::abs(FaceNormal(mesh, samples[i].face).dot(FaceNormal(other, nearest.face)));
  });
  return measured;
}

}  // namespace

struct Evaluator::Impl {
  TriangleMesh truth;
  std::vector<SceneView> views;
  int classes = 0;
  TruthLabelSource truth_labels;
  EvaluationOptions options;
  std::optional<HorizontalBox> box;
  std::optional<NearestSurface> truth_surface;
  std::vector<SurfaceSample> truth_samples;  // the used points of the truth

  std::vector<SurfaceSample> CountedSamples(const TriangleMesh& mesh, const RayCaster& caster) const {
    std::vector<SurfaceSample> inside;
    for (const SurfaceSample& sample : SampleByArea(mesh, options.samples, options.seed)) {
      if (box->Contains(sample.point)) inside.push_back(sample);
    }
    return SeenSamples(inside, caster, views, options.min_views);
  }

  Status AddPixelLabels(const TriangleMesh& mesh, const RayCaster& caster, Evaluation* evaluation) const;
};

Evaluator::Evaluator(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Evaluator::~Evaluator() = default;
Evaluator::Evaluator(Evaluator&&) noexcept = default;
Evaluator& Evaluator::operator=(Evaluator&&) noexcept = default;

StatusOr<Evaluator> Evaluator::Create(TriangleMesh truth, std::vector<SceneView> views, int classes,
                                      TruthLabelSource truth_labels, EvaluationOptions options) {
  if (truth.faces.empty()) return InputError("truth mesh", "", "no faces", "at least one face");
  TESSERA_RETURN_IF_ERROR(CheckLabels(truth, classes, "truth mesh"));
  auto impl = std::make_unique<Impl>();
  impl->truth = std::move(truth);
  impl->views = std::move(views);
  impl->classes = classes;
  impl->truth_labels = std::move(truth_labels);
  impl->options = std::move(options);
  impl->box.emplace(impl->truth, impl->options.up_in_local, impl->options.rim_m);
  impl->truth_surface.emplace(impl->truth);
  impl->truth_samples = impl->CountedSamples(impl->truth, RayCaster(impl->truth));
  if (impl->truth_samples.empty()) {
    return absl::FailedPreconditionError(
        "no point of the truth is both visible in " + std::to_string(impl->options.min_views) + " views and at least " +
        std::to_string(impl->options.rim_m) + " m inside its bounding box: use fewer views or a smaller rim");
  }
  return Evaluator(std::move(impl));
}

Status Evaluator::Impl::AddPixelLabels(const TriangleMesh& mesh, const RayCaster& caster,
                                       Evaluation* evaluation) const {
  PixelLabelEvaluation labels;
  labels.confusion = ConfusionMatrix(classes);
  labels.boundaries.resize(classes);
  for (size_t i = 0; i < views.size(); ++i) {
    TESSERA_ASSIGN_OR_RETURN(const LabelImage stored, truth_labels(i));
    if (stored.empty()) continue;
    ++labels.views;
    const LabelImage truth_image = UndistortLabels(stored, views[i].lens);
    const LabelImage result = RenderLabels(mesh, caster, views[i].camera);
    for (size_t p = 0; p < result.data.size(); ++p) {
      const int truth_label = truth_image.data[p];
      if (truth_label != 255 && truth_label >= classes) {
        return InputError("truth image of " + views[i].name, "", "class " + std::to_string(truth_label),
                          "a class below " + std::to_string(classes) + ", or 255 for unknown");
      }
      labels.confusion.Add(truth_label, result.data[p]);
    }
    CountBoundaries(result, truth_image, options.boundary_reach_px, &labels.boundaries);
  }
  if (labels.views == 0) return absl::OkStatus();
  labels.scores = ScoreLabels(labels.confusion);
  labels.boundary_f = MeanBoundaryF(labels.boundaries);
  evaluation->labels_by_pixels = std::move(labels);
  return absl::OkStatus();
}

StatusOr<Evaluation> Evaluator::Evaluate(const TriangleMesh& mesh) const {
  if (mesh.faces.empty()) return InputError("mesh", "", "no faces", "at least one face");
  TESSERA_RETURN_IF_ERROR(CheckLabels(mesh, impl_->classes, "mesh"));
  const TriangleMesh& truth = impl_->truth;
  Evaluation evaluation;
  evaluation.faces = static_cast<int64_t>(mesh.faces.size());
  for (size_t f = 0; f < mesh.faces.size(); ++f) evaluation.area_m2 += FaceArea(mesh, f);

  const RayCaster caster(mesh);
  const std::vector<SurfaceSample> samples = impl_->CountedSamples(mesh, caster);
  Measured on_mesh = Measure(samples, mesh, truth, *impl_->truth_surface);
  for (size_t i = 0; i < samples.size(); ++i) {
    on_mesh.points[i].truth_class = LabelOf(truth, on_mesh.nearest_face[i]);
  }
  const NearestSurface surface(mesh);
  Measured on_truth = Measure(impl_->truth_samples, truth, mesh, surface);
  ConfusionMatrix by_area(impl_->classes);
  for (size_t i = 0; i < impl_->truth_samples.size(); ++i) {
    on_truth.points[i].truth_class = LabelOf(truth, impl_->truth_samples[i].face);
    by_area.Add(on_truth.points[i].truth_class, LabelOf(mesh, on_truth.nearest_face[i]));
  }

  const EvaluationOptions& options = impl_->options;
  evaluation.surface = ScoreSurface(on_mesh.points, on_truth.points, options.cap_m, options.f_distances_m);
  if (!truth.labels.empty()) {
    for (int c = 0; c < impl_->classes; ++c) {
      evaluation.surface_by_class.push_back(
          ScoreSurface(on_mesh.points, on_truth.points, options.cap_m, options.f_distances_m, c));
    }
  }
  if (mesh.labels.empty()) return evaluation;
  if (!truth.labels.empty()) evaluation.labels_by_area = LabelEvaluation{by_area, ScoreLabels(by_area)};
  if (impl_->truth_labels) TESSERA_RETURN_IF_ERROR(impl_->AddPixelLabels(mesh, caster, &evaluation));
  return evaluation;
}

}  // namespace tessera
