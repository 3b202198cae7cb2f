// Calibration of classifier scores, so that predicted probabilities equal observed frequencies.
#pragma once

#include <cstdint>
#include <vector>

namespace tessera {

// Scores of samples that were not used for training.
struct HeldOutScores {
  int classes = 0;
  std::vector<float> scores;  // scores[i * classes + c]
  std::vector<uint8_t> labels;
  std::vector<float> weights;
  int64_t count() const { return static_cast<int64_t>(labels.size()); }
};

// Temperature scaling (Guo et al. 2017): the divisor of the scores, in [0.2, 20], that maximises the likelihood of the
// held-out labels; 1 without samples.
double FitTemperature(const HeldOutScores& held_out);

// Weighted mean of -log(probability of the label).
double MeanLogLoss(const HeldOutScores& held_out, double temperature);

// Expected calibration error: the weighted mean over 20 bins of |mean highest probability - accuracy|. Samples are
// binned by their highest probability.
double CalibrationError(const HeldOutScores& held_out, double temperature);

// Replaces scores by softmax(scores / temperature).
void SoftmaxInPlace(float* scores, int classes, double temperature);

}  // namespace tessera
