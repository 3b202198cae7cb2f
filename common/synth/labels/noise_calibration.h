// Calibration of label noise: finds the thresholds at which start labels and likelihoods have the target accuracy, so
// that all cities are equally difficult.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "common/synth/labels/label_noise.h"
#include "common/synth/start_mesh/start_mesh.h"

namespace tessera {

// Confusion matrix: weight[true class][label].
struct ClassConfusion {
  std::array<std::array<double, kCityClasses>, kCityClasses> weight{};
  std::array<double, kCityClasses> missing{};  // weight without a label; counts as wrong

  // Mean recall over the classes with weight.
  double AverageAccuracy() const;
};

// A start label seen in a view: the face of the start mesh and the true class along one ray.
struct StartLabelSample {
  uint32_t chunk;
  uint32_t face;  // index in the chunk; kNoFace: the ray misses the start mesh
  uint8_t true_label;
  static constexpr uint32_t kNoFace = ~0u;
};

// Casts up to `rays_per_view` rays of each view at both surfaces. Uses only hits on the blocks of `range`.
std::vector<StartLabelSample> SampleStartLabels(const CityScene& scene, const std::vector<const StartChunk*>& chunks,
                                                const std::vector<const SynthView*>& views, int rays_per_view,
                                                const BlockRange& range);

// Adds the areas of a chunk's faces, with their labels at `threshold`.
void AddByArea(const StartChunk& chunk, double threshold, ClassConfusion& confusion);
ClassConfusion CountByPixels(const std::vector<const StartChunk*>& chunks, const std::vector<StartLabelSample>& samples,
                             double threshold);

inline int32_t StartLabel(const StartChunk& chunk, size_t face, double threshold) {
  return chunk.doubt[face] > threshold ? chunk.wrong_labels[face] : chunk.right_labels[face];
}

// The threshold at which the mean of the accuracy by area and (if there are samples) by pixels equals
// kStartAverageAccuracy. Accuracy by pixels also includes geometric errors of the start mesh. If these are too large
// (large voxels, as in the toy scene), the accuracy by area stays in its range and that by pixels falls below it.
double CalibrateStartLabels(const std::vector<const StartChunk*>& chunks, const std::vector<StartLabelSample>& samples);

// The threshold at which the likeliest class is correct in the share kLikelihoodArgmaxAccuracy of the pixels of
// `views`.
double CalibrateLikelihoods(const CityScene& scene, const std::vector<const SynthView*>& views,
                            const std::vector<uint64_t>& seeds);

}  // namespace tessera
