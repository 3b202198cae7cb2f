// From scores to probabilities that are right as often as they say.
#ifndef TESSERA_COMMON_CLASSIFY_CALIBRATION_H_
#define TESSERA_COMMON_CLASSIFY_CALIBRATION_H_

#include <cstdint>
#include <vector>

namespace tessera {

// Scores of samples that the classifier had not learnt from.
struct HeldOutScores {
  int classes = 0;
  std::vector<float> scores;  // a sample's classes side by side
  std::vector<uint8_t> labels;
  std::vector<float> weights;
  int64_t count() const { return static_cast<int64_t>(labels.size()); }
};

// Temperature by which scores are divided so that the likelihood of the held-out labels is greatest (Guo et al. 2017),
// in [0.2, 20]; 1 without samples.
double FitTemperature(const HeldOutScores& held_out);

// Mean over samples of -log of the probability given to the label.
double MeanLogLoss(const HeldOutScores& held_out, double temperature);

// Expected calibration error: mean distance between the highest probability and how often it is right, over 20 bins of
// that probability, weighted by their samples.
double CalibrationError(const HeldOutScores& held_out, double temperature);

// Softmax of scores / temperature, in place.
void SoftmaxInPlace(float* scores, int classes, double temperature);

}  // namespace tessera

#endif  // TESSERA_COMMON_CLASSIFY_CALIBRATION_H_
