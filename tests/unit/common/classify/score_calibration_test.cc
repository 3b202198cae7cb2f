#include "common/classify/score_calibration.h"

#include <gtest/gtest.h>

#include <cmath>

#include "common/base/parallel.h"
#include "common/base/random.h"

namespace tessera {
namespace {

// Labels are drawn from softmax(scores / truth), so the right temperature is `truth`.
HeldOutScores Overconfident(double truth, int64_t count, uint64_t seed) {
  HeldOutScores held_out;
  held_out.classes = 3;
  Random random(seed);
  for (int64_t i = 0; i < count; ++i) {
    float scores[3], p[3];
    for (int c = 0; c < 3; ++c) p[c] = scores[c] = static_cast<float>(4 * random.Normal());
    SoftmaxInPlace(p, 3, truth);
    const double u = random.Uniform();
    held_out.labels.push_back(u < p[0] ? 0 : u < p[0] + p[1] ? 1 : 2);
    held_out.scores.insert(held_out.scores.end(), scores, scores + 3);
    held_out.weights.push_back(1);
  }
  return held_out;
}

TEST(CalibrationTest, RecoversTheTemperature) {
  for (const double truth : {0.5, 1.0, 3.0}) {
    EXPECT_NEAR(FitTemperature(Overconfident(truth, 20000, 1)), truth, 0.07 * truth);
  }
}

TEST(CalibrationTest, ReducesCalibrationErrorOnOtherSamples) {
  const HeldOutScores others = Overconfident(3, 20000, 2);
  const double temperature = FitTemperature(Overconfident(3, 20000, 1));
  EXPECT_GT(CalibrationError(others, 1), 0.1);
  EXPECT_LT(CalibrationError(others, temperature), 0.02);
  EXPECT_LT(MeanLogLoss(others, temperature), 0.8 * MeanLogLoss(others, 1));
}

TEST(CalibrationTest, UsesWeights) {
  HeldOutScores both = Overconfident(3, 5000, 1);
  HeldOutScores sure = Overconfident(0.5, 5000, 2);
  both.scores.insert(both.scores.end(), sure.scores.begin(), sure.scores.end());
  both.labels.insert(both.labels.end(), sure.labels.begin(), sure.labels.end());
  both.weights.insert(both.weights.end(), 5000, 1e-6f);
  EXPECT_NEAR(FitTemperature(both), 3, 0.3);
}

TEST(CalibrationTest, TemperatureIsOneWithoutSamples) { EXPECT_EQ(FitTemperature({}), 1); }

TEST(CalibrationTest, DoesNotDependOnThreads) {
  const HeldOutScores held_out = Overconfident(2, 50000, 1);
  double one = 0;
  {
    const ThreadLimit limit(1);
    one = FitTemperature(held_out);
  }
  const ThreadLimit limit(4);
  EXPECT_EQ(FitTemperature(held_out), one);
}

}  // namespace
}  // namespace tessera
