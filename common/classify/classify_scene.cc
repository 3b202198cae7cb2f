#include "common/classify/classify_scene.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <mutex>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/classify/features.h"
#include "common/classify/score_calibration.h"
#include "common/imaging/image_io.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr int kBatch = 64;  // pixels of a row that are classified together
constexpr double kWeightOfAnnotatedLocation = 0.25;
constexpr int kRows = 16;  // rows per parallel chunk

// The classification of one image.
struct ViewResult {
  std::array<ByteImage, 2> likelihoods;
  std::array<ConfusionMatrix, 2> held_out;
  ViewStatistics figures;
};

class ViewClassifier {
 public:
  ViewClassifier(const SceneDescription& scene, const MeshSurface* surface, const ClassifierSelection& classifier)
      : scene_(scene), surface_(surface), use_(classifier), classes_(static_cast<int>(scene.classes.size())) {}

  // Classifies with the evidence `first` and those after it.
  StatusOr<ViewResult> Classify(size_t view, Evidence first) const {
    const SceneView& scene_view = scene_.views[view];
    TESSERA_ASSIGN_OR_RETURN(const ByteImage rgb,
                             ReadRgb(scene_.folder + "/" + scene_view.image_path, scene_view.white_level));
    const ImageFeatures features(rgb, scene_view, scene_.up_in_local, surface_);
    const Annotation* annotation = nullptr;
    if (use_.annotations != nullptr) {
      for (const Annotation& a : use_.annotations->images) {
        if (a.view == view) annotation = &a;
      }
    }
    ViewResult result;
    result.figures.annotated = annotation != nullptr;
    const size_t first_output = use_.rule != nullptr ? 1 : static_cast<size_t>(first);
    for (size_t e = first_output; e < 2; ++e) {
      result.likelihoods[e] = ByteImage(rgb.width, rgb.height, classes_);
      result.held_out[e] = ConfusionMatrix(classes_);
    }
    const int parts = (rgb.height + kRows - 1) / kRows;
    std::vector<RowsResult> of_parts(parts);
    ParallelForEach(parts, 1, [&](int part) {
      const int y = part * kRows;
      of_parts[part] = ClassifyRows(features, annotation, first_output, static_cast<uint32_t>(view), y,
                                    std::min(y + kRows, rgb.height), rgb.width, &result.likelihoods);
    });
    RowsResult sum;
    for (const RowsResult& part : of_parts) {
      sum.entropy += part.entropy;
      sum.gain += part.gain;
      sum.known += part.known;
      for (size_t e = first_output; e < 2; ++e) result.held_out[e].Add(part.held_out[e]);
    }
    const double pixels = static_cast<double>(rgb.plane_size());
    result.figures.entropy = sum.entropy / pixels;
    result.figures.new_share = 1 - static_cast<double>(sum.known) / pixels;
    result.figures.gain = sum.gain / pixels;
    return result;
  }

 private:
  // Sums over some rows of an image.
  struct RowsResult {
    double entropy = 0, gain = 0;
    int64_t known = 0;
    std::array<ConfusionMatrix, 2> held_out;
  };

  RowsResult ClassifyRows(const ImageFeatures& features, const Annotation* annotation, size_t first_output,
                          uint32_t view, int y_begin, int y_end, int width,
                          std::array<ByteImage, 2>* likelihoods) const {
    RowsResult result;
    for (size_t e = first_output; e < 2; ++e) result.held_out[e] = ConfusionMatrix(classes_);
    std::vector<float> values(static_cast<size_t>(FeatureCount()) * kBatch);
    std::vector<float> p(static_cast<size_t>(classes_) * kBatch), of_fold(p.size());
    std::vector<int> fold(kBatch);
    for (int y = y_begin; y < y_end; ++y) {
      for (int x = 0; x < width; x += kBatch) {
        const int count = std::min(kBatch, width - x);
        features.Row(x, y, count, kBatch, values.data());
        for (int i = 0; i < count; ++i) {
          fold[i] =
              use_.trained == nullptr ? -1 : use_.trained->spatial_folds.FoldOf(features.LocationOf(x + i, y, view));
        }
        for (size_t e = first_output; e < 2; ++e) {
          if (use_.rule != nullptr) {
            use_.rule->Apply(values.data(), count, kBatch, p.data());
          } else {
            Probabilities(e, values.data(), count, annotation != nullptr ? &fold : nullptr, &of_fold, p.data());
          }
          Store(annotation, x, y, count, p.data(), &(*likelihoods)[e], &result.held_out[e]);
        }
        // `p` now holds the last output: the likelihoods with the mesh.
        for (int i = 0; i < count; ++i) {
          double h = 0;
          for (int c = 0; c < classes_; ++c) {
            const double q = p[static_cast<size_t>(i) * classes_ + c];
            if (q > 1e-9) h -= q * std::log(q);
          }
          h /= std::log(std::max(2, classes_));
          result.entropy += h;
          result.known += fold[i] >= 0;
          result.gain += h * (fold[i] >= 0 ? kWeightOfAnnotatedLocation : 1);
        }
      }
    }
    return result;
  }

  // Class probabilities of the model, in the scene's order of classes. Pixels with fold[i] >= 0 use the trees of that
  // fold, which were not trained on the pixel's cell; else the pixel's own annotation would leak into its likelihood.
  void Probabilities(size_t evidence, const float* values, int count, const std::vector<int>* fold,
                     std::vector<float>* scratch, float* p) const {
    const ClassifierPart& part = use_.model->parts[evidence];
    const int classes = part.trees.classes;
    std::vector<float> scores(static_cast<size_t>(classes) * kBatch);
    part.trees.Score(values, count, kBatch, scores.data());
    if (fold != nullptr) {
      scratch->resize(scores.size());
      for (size_t k = 0; k < use_.trained->folds.size(); ++k) {
        if (std::find(fold->begin(), fold->begin() + count, static_cast<int>(k)) == fold->begin() + count) continue;
        use_.trained->folds[k][evidence].Score(values, count, kBatch, scratch->data());
        for (int i = 0; i < count; ++i) {
          if ((*fold)[i] == static_cast<int>(k)) {
            std::copy_n(scratch->begin() + i * classes, classes, scores.begin() + i * classes);
          }
        }
      }
    }
    for (int i = 0; i < count; ++i) {
      float* of_pixel = scores.data() + static_cast<size_t>(i) * classes;
      SoftmaxInPlace(of_pixel, classes, part.temperature);
      for (int c = 0; c < classes_; ++c) {
        p[static_cast<size_t>(i) * classes_ + c] = of_pixel[use_.class_of_scene.empty() ? c : use_.class_of_scene[c]];
      }
    }
  }

  void Store(const Annotation* annotation, int x, int y, int count, const float* p, ByteImage* image,
             ConfusionMatrix* held_out) const {
    for (int i = 0; i < count; ++i) {
      const float* of_pixel = p + static_cast<size_t>(i) * classes_;
      for (int c = 0; c < classes_; ++c) {
        // At least 1, so that no pixel excludes a class.
        image->at(x + i, y, c) = static_cast<uint8_t>(std::clamp(std::lround(255 * of_pixel[c]), 1l, 255l));
      }
      if (annotation == nullptr) continue;
      const uint8_t truth = annotation->labels.at(x + i, y);
      if (truth != 255) {
        held_out->Add(truth, static_cast<int>(std::max_element(of_pixel, of_pixel + classes_) - of_pixel));
      }
    }
  }

  const SceneDescription& scene_;
  const MeshSurface* surface_;
  const ClassifierSelection& use_;
  const int classes_;
};

}  // namespace

StatusOr<ByteImage> ClassifyView(const SceneDescription& scene, size_t view, const MeshSurface* surface,
                                 const ClassifierSelection& classifier) {
  const Evidence evidence =
      surface == nullptr && classifier.model != nullptr ? Evidence::kAppearance : Evidence::kGeometry;
  TESSERA_ASSIGN_OR_RETURN(ViewResult result, ViewClassifier(scene, surface, classifier).Classify(view, evidence));
  return std::move(result.likelihoods[static_cast<size_t>(evidence)]);
}

StatusOr<ClassifiedScene> ClassifyScene(const SceneDescription& scene, const MeshSurface& surface,
                                        const ClassifierSelection& classifier, const std::string& folder,
                                        const TaskControl& control) {
  const size_t views = scene.views.size();
  const ViewClassifier of_views(scene, &surface, classifier);
  std::vector<Status> failed(views);
  std::vector<std::array<ConfusionMatrix, 2>> held_out(views);
  ClassifiedScene classified;
  classified.views.resize(views);
  const std::vector<std::string> stems = ViewStems(scene);
  std::atomic<int64_t> done = 0;
  ParallelForEach(views, 1, [&](size_t v) {
    failed[v] = control.Check();
    if (!failed[v].ok()) return;
    StatusOr<ViewResult> result = of_views.Classify(v, Evidence::kAppearance);
    if (!result.ok()) {
      failed[v] = result.status();
      return;
    }
    for (size_t e = 0; e < 2 && failed[v].ok(); ++e) {
      if (result->likelihoods[e].empty()) continue;
      const fs::path path = fs::path(folder) / kEvidenceNames[e] / (stems[v] + ".tif");
      failed[v] = EnsureFolder(path.parent_path().string());
      if (failed[v].ok()) failed[v] = WriteLikelihoodTiff(path.string(), result->likelihoods[e]);
    }
    classified.views[v] = result->figures;
    held_out[v] = std::move(result->held_out);
    const int64_t now = ++done;
    control.Report(static_cast<double>(now) / static_cast<double>(views), absl::StrCat("image ", now, " of ", views));
  });
  for (const Status& status : failed) TESSERA_RETURN_IF_ERROR(status);
  for (size_t e = 0; e < 2; ++e) {
    classified.held_out[e] = ConfusionMatrix(static_cast<int>(scene.classes.size()));
    for (const auto& of_view : held_out) {
      if (of_view[e].classes() > 0) classified.held_out[e].Add(of_view[e]);
    }
  }
  for (const SceneView& view : scene.views) {
    classified.pixels += int64_t{1} * view.lens.pinhole.width * view.lens.pinhole.height;
  }
  return classified;
}

}  // namespace tessera
