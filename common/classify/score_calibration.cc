#include "common/classify/score_calibration.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr double kLowest = 0.2, kHighest = 20;
constexpr int kReliabilityBins = 20;

double LogLossSum(const HeldOutScores& held_out, double temperature) {
  return ParallelSum(held_out.count(), 4096, [&](int64_t begin, int64_t end) {
    double sum = 0;
    for (int64_t i = begin; i < end; ++i) {
      const float* score = held_out.scores.data() + i * held_out.classes;
      const double highest = *std::max_element(score, score + held_out.classes);
      double mass = 0;
      for (int c = 0; c < held_out.classes; ++c) mass += std::exp((score[c] - highest) / temperature);
      sum += held_out.weights[i] * (std::log(mass) - (score[held_out.labels[i]] - highest) / temperature);
    }
    return sum;
  });
}

}  // namespace

void SoftmaxInPlace(float* scores, int classes, double temperature) {
  const float highest = *std::max_element(scores, scores + classes);
  const float scale = static_cast<float>(1 / temperature);
  float sum = 0;
  for (int c = 0; c < classes; ++c) sum += scores[c] = std::exp((scores[c] - highest) * scale);
  for (int c = 0; c < classes; ++c) scores[c] /= sum;
}

double MeanLogLoss(const HeldOutScores& held_out, double temperature) {
  double weight = 0;
  for (const float w : held_out.weights) weight += w;
  return weight > 0 ? LogLossSum(held_out, temperature) / weight : 0;
}

double FitTemperature(const HeldOutScores& held_out) {
  if (held_out.count() == 0) return 1;
  // Golden-section search over log(temperature). The loss is convex in 1 / temperature, so it has one minimum.
  const double golden = (std::sqrt(5.0) - 1) / 2;
  double low = std::log(kLowest), high = std::log(kHighest);
  double a = high - golden * (high - low), b = low + golden * (high - low);
  double loss_a = LogLossSum(held_out, std::exp(a)), loss_b = LogLossSum(held_out, std::exp(b));
  for (int i = 0; i < 30; ++i) {
    if (loss_a < loss_b) {
      high = b;
      b = a;
      loss_b = loss_a;
      a = high - golden * (high - low);
      loss_a = LogLossSum(held_out, std::exp(a));
    } else {
      low = a;
      a = b;
      loss_a = loss_b;
      b = low + golden * (high - low);
      loss_b = LogLossSum(held_out, std::exp(b));
    }
  }
  return std::exp(0.5 * (low + high));
}

double CalibrationError(const HeldOutScores& held_out, double temperature) {
  struct Bin {
    double weight = 0, predicted = 0, correct = 0;
  };
  std::array<Bin, kReliabilityBins> bins;
  std::vector<float> p(held_out.classes);
  double total = 0;
  for (int64_t i = 0; i < held_out.count(); ++i) {
    std::copy_n(held_out.scores.data() + i * held_out.classes, held_out.classes, p.begin());
    SoftmaxInPlace(p.data(), held_out.classes, temperature);
    const auto best = std::max_element(p.begin(), p.end());
    Bin& bin = bins[std::min(kReliabilityBins - 1, static_cast<int>(*best * kReliabilityBins))];
    bin.weight += held_out.weights[i];
    bin.predicted += held_out.weights[i] * *best;
    if (best - p.begin() == held_out.labels[i]) bin.correct += held_out.weights[i];
    total += held_out.weights[i];
  }
  double error = 0;
  for (const Bin& bin : bins) error += std::abs(bin.predicted - bin.correct);
  return total > 0 ? error / total : 0;
}

}  // namespace tessera
