// Makes every city equally hard: finds the thresholds at which start labels and likelihoods are as wrong as they
// should.
#ifndef TESSERA_COMMON_SYNTH_NOISE_CALIBRATION_H_
#define TESSERA_COMMON_SYNTH_NOISE_CALIBRATION_H_

#include <array>
#include <cstdint>
#include <vector>

#include "common/synth/label_noise.h"
#include "common/synth/start_mesh.h"

namespace tessera {

// How much of each true class (first index) got which label.
struct ClassConfusion {
  std::array<std::array<double, kCityClasses>, kCityClasses> weight{};
  std::array<double, kCityClasses> missing{};  // nothing was there: counts as wrong

  // Mean recall over the classes that occur.
  double AverageAccuracy() const;
};

// Start labels seen in views: the face that a ray meets on the start mesh, and what it meets on the true surface.
struct StartLabelSample {
  uint32_t chunk;
  uint32_t face;  // of the chunk; kNothing: the ray misses the start mesh
  uint8_t true_label;
  static constexpr uint32_t kNothing = ~0u;
};

// Casts up to `rays_per_view` rays of each view against both surfaces. Counts only what lies on the blocks of `range`.
std::vector<StartLabelSample> SampleStartLabels(const CityScene& scene, const std::vector<const StartChunk*>& chunks,
                                                const std::vector<const SynthView*>& views, int rays_per_view,
                                                const BlockRange& range);

// Adds the faces of a chunk, labelled at `threshold`, by area.
void AddByArea(const StartChunk& chunk, double threshold, ClassConfusion& confusion);
ClassConfusion CountByPixels(const std::vector<const StartChunk*>& chunks, const std::vector<StartLabelSample>& samples,
                             double threshold);

inline int32_t StartLabel(const StartChunk& chunk, size_t face, double threshold) {
  return chunk.doubt[face] > threshold ? chunk.wrong_labels[face] : chunk.right_labels[face];
}

// The threshold at which the mean of the accuracies by area and (if there are samples) by pixels meets the aim. By
// pixels also the start's misplaced surfaces count; where they cost more than the range is wide (voxels as large as
// rooms, as in the toy) the accuracy by area stays in the range and that by pixels falls below it.
double CalibrateStartLabels(const std::vector<const StartChunk*>& chunks, const std::vector<StartLabelSample>& samples);

// The threshold at which likelihoods made for `views` name the true class in the aimed share of all pixels.
double CalibrateLikelihoods(const CityScene& scene, const std::vector<const SynthView*>& views,
                            const std::vector<uint64_t>& seeds);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_NOISE_CALIBRATION_H_
