#include "common/classify/training.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/base/random.h"
#include "common/classify/features.h"
#include "common/imaging/image_io.h"

namespace tessera {
namespace {

constexpr double kClassBalance = 0.25;  // weight of a class: its share of the annotated pixels to this power
constexpr int kFolds = 4;

// Pixels drawn from one image.
struct DrawnPixels {
  std::vector<float> features;  // features[i * FeatureCount() + f]
  std::vector<uint8_t> labels;
  std::vector<PixelLocation> locations;
};

// The probability of each class's pixels to be drawn.
std::vector<double> DrawChances(const Annotations& annotations, int64_t samples) {
  std::vector<double> roots, chances;
  double sum = 0;
  for (const int64_t pixels : annotations.pixels) {
    roots.push_back(std::sqrt(static_cast<double>(pixels)));
    sum += roots.back();
  }
  for (size_t c = 0; c < roots.size(); ++c) {
    const double pixels = static_cast<double>(std::max<int64_t>(1, annotations.pixels[c]));
    chances.push_back(std::min(1.0, static_cast<double>(samples) * roots[c] / sum / pixels));
  }
  return chances;
}

StatusOr<DrawnPixels> Draw(const SceneDescription& scene, const Annotation& annotation, const MeshSurface& surface,
                           const std::vector<double>& chances, uint64_t seed) {
  const SceneView& view = scene.views[annotation.view];
  TESSERA_ASSIGN_OR_RETURN(const ByteImage rgb, ReadRgb(scene.folder + "/" + view.image_path, view.white_level));
  const ImageFeatures features(rgb, view, scene.up_in_local, &surface);
  DrawnPixels drawn;
  std::vector<float> pixel(FeatureCount());
  Random random(MixBits(seed) + annotation.view);
  for (int y = 0; y < annotation.labels.height; ++y) {
    for (int x = 0; x < annotation.labels.width; ++x) {
      const uint8_t label = annotation.labels.at(x, y);
      if (label == 255 || random.Uniform() >= chances[label]) continue;
      features.Row(x, y, 1, 1, pixel.data());
      drawn.features.insert(drawn.features.end(), pixel.begin(), pixel.end());
      drawn.labels.push_back(label);
      drawn.locations.push_back(features.LocationOf(x, y, static_cast<uint32_t>(annotation.view)));
    }
  }
  return drawn;
}

struct Samples {
  TrainingSamples training;
  std::vector<float> natural;  // weights that restore the class frequencies of all annotated pixels
  std::vector<PixelLocation> locations;
};

StatusOr<Samples> DrawAll(const SceneDescription& scene, const Annotations& annotations, const MeshSurface& surface,
                          const TrainingOptions& options, const TaskControl& control) {
  const std::vector<double> chances = DrawChances(annotations, options.samples);
  const size_t images = annotations.images.size();
  std::vector<StatusOr<DrawnPixels>> drawn(images, absl::InternalError("not drawn"));
  ParallelForEach(images, 1, [&](size_t i) {
    if (!control.Check().ok()) return;
    drawn[i] = Draw(scene, annotations.images[i], surface, chances, options.seed);
  });
  TESSERA_RETURN_IF_ERROR(control.Check());
  Samples samples;
  TrainingSamples& training = samples.training;
  training.feature_count = FeatureCount();
  for (const StatusOr<DrawnPixels>& of_image : drawn) {
    TESSERA_RETURN_IF_ERROR(of_image.status());
    training.labels.insert(training.labels.end(), of_image->labels.begin(), of_image->labels.end());
    samples.locations.insert(samples.locations.end(), of_image->locations.begin(), of_image->locations.end());
  }
  training.count = static_cast<int64_t>(training.labels.size());
  training.features.resize(training.count * training.feature_count);
  int64_t first = 0;
  for (const StatusOr<DrawnPixels>& of_image : drawn) {
    const int64_t count = static_cast<int64_t>(of_image->labels.size());
    for (int64_t i = 0; i < count; ++i) {
      for (int f = 0; f < training.feature_count; ++f) {
        training.features[f * training.count + first + i] = of_image->features[i * training.feature_count + f];
      }
    }
    first += count;
  }
  std::vector<double> class_samples(annotations.pixels.size(), 0);
  for (const uint8_t label : training.labels) class_samples[label] += 1;
  const double all = static_cast<double>(annotations.annotated());
  for (const uint8_t label : training.labels) {
    const double share = static_cast<double>(annotations.pixels[label]) / all;
    const double count = static_cast<double>(training.count) / class_samples[label];
    samples.natural.push_back(static_cast<float>(share * count));
    training.weights.push_back(static_cast<float>(std::pow(share, kClassBalance) * count));
  }
  return samples;
}

// The samples with only their first `features` columns; appearance features come first.
TrainingSamples Prefix(const TrainingSamples& samples, int features) {
  TrainingSamples prefix = samples;
  prefix.feature_count = features;
  prefix.features.resize(samples.count * features);
  return prefix;
}

}  // namespace

StatusOr<TrainedClassifier> TrainClassifier(const SceneDescription& scene, const Annotations& annotations,
                                            const MeshSurface& surface, double gsd_m, const TrainingOptions& options,
                                            const TaskControl& control) {
  control.Report(0, "drawing pixels");
  TESSERA_ASSIGN_OR_RETURN(const Samples samples, DrawAll(scene, annotations, surface, options, control));
  TrainedClassifier trained;
  trained.samples = samples.training.count;
  trained.spatial_folds = SpatialFolds::Of(samples.locations, kFolds);
  const int folds = trained.spatial_folds.folds(), classes = static_cast<int>(scene.classes.size());
  if (folds < 2) {
    return InputError(annotations.images.front().path, "", "annotated pixels in one small area only",
                      "annotations in several areas, for training and for testing");
  }
  std::vector<int> fold_of_sample;
  for (const PixelLocation& location : samples.locations)
    fold_of_sample.push_back(trained.spatial_folds.FoldOf(location));
  trained.model.classes = ClassNames(scene);
  trained.model.features = FeatureNames();
  trained.model.gsd_m = gsd_m;
  trained.folds.resize(folds);

  int done = 0;
  const int fits = 2 * (folds + 1);
  for (size_t e = 0; e < trained.model.parts.size(); ++e) {
    const bool appearance = static_cast<Evidence>(e) == Evidence::kAppearance;
    const TrainingSamples columns = Prefix(samples.training, appearance ? AppearanceFeatureCount() : FeatureCount());
    HeldOutScores held_out;
    held_out.classes = classes;
    for (int fold = 0; fold <= folds; ++fold) {
      TESSERA_RETURN_IF_ERROR(control.Check());
      control.Report(0.1 + 0.9 * done / fits, absl::StrCat("training on ", kEvidenceNames[e]));
      std::vector<uint32_t> rows, held_out_rows;
      for (uint32_t i = 0; i < fold_of_sample.size(); ++i) {
        (fold_of_sample[i] == fold ? held_out_rows : rows).push_back(i);
      }
      BoostingOptions boosting = options.boosting;
      boosting.seed = MixBits(options.seed + e) + fold;
      BoostedTrees trees = TrainBoostedTrees(columns, rows, classes, boosting);
      ++done;
      if (fold == folds) {
        trained.model.parts[e].trees = std::move(trees);
        break;
      }
      std::vector<float> pixel(columns.feature_count), scores(classes);
      for (const uint32_t row : held_out_rows) {
        for (int f = 0; f < columns.feature_count; ++f) pixel[f] = columns.column(f)[row];
        trees.Score(pixel.data(), 1, 1, scores.data());
        held_out.scores.insert(held_out.scores.end(), scores.begin(), scores.end());
        held_out.labels.push_back(columns.labels[row]);
        held_out.weights.push_back(samples.natural[row]);
      }
      trained.folds[fold][e] = std::move(trees);
    }
    HeldOutStatistics& figures = trained.held_out[e];
    figures.temperature = FitTemperature(held_out);
    figures.log_loss_before = MeanLogLoss(held_out, 1);
    figures.log_loss_after = MeanLogLoss(held_out, figures.temperature);
    figures.calibration_error_before = CalibrationError(held_out, 1);
    figures.calibration_error_after = CalibrationError(held_out, figures.temperature);
    trained.model.parts[e].temperature = figures.temperature;
  }
  return trained;
}

}  // namespace tessera
