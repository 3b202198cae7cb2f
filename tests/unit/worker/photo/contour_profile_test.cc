#include "worker/photo/contour_profile.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tessera {
namespace {

constexpr int kReach = ContourProfile::kReach;
constexpr BorderTrust kTrusted = {0, 0.5, 1};

// Front class up to `border` pixels outwards, and an image edge at `edge`, which may be inside a pixel.
ContourProfile Profile(double border, double edge, double contrast = 0.3) {
  ContourProfile profile;
  for (int k = 0; k < ContourProfile::kPixels; ++k) {
    profile.front_gain[k] = k - kReach < border ? 0.8 : -0.8;
    profile.luminance[k] = 0.3 + contrast * std::min(1.0, std::max(0.0, k + 1 - (edge + kReach)));
  }
  return profile;
}

TEST(ContourProfile, MeasuresTheImageEdge) {
  for (const double edge : {-3.0, -1.5, -0.5, 0.0, 0.25, 1.0, 2.5, 3.0}) {
    const ContourMeasurement measured = MeasureContour(Profile(std::round(edge), edge), kTrusted, 1);
    EXPECT_NEAR(measured.outward_px, edge, 0.3) << edge;
    EXPECT_GT(measured.weight, 0.7) << edge;
  }
}

TEST(ContourProfile, ImageEdgeOverridesLikelihoodsThatAreOnePixelOff) {
  for (const int off : {-1, 1}) {
    EXPECT_NEAR(MeasureContour(Profile(off, 0), kTrusted, 1).outward_px, 0, 0.4) << off;
  }
}

TEST(ContourProfile, KnownBiasOfBordersIsSubtracted) {
  // The likelihoods show the front three pixels too large, which is half as much on the next pyramid level.
  BorderTrust off = kTrusted;
  off.bias_px = 3;
  EXPECT_NEAR(MeasureContour(Profile(3, 0), off, 1).outward_px, 0, 0.3);
  EXPECT_NEAR(MeasureContour(Profile(2, 0.5), off, 0.5).outward_px, 0.5, 0.3);
}

TEST(ContourProfile, NeedsABorderAnEdgeAndTrust) {
  EXPECT_EQ(MeasureContour(Profile(kReach, 0), kTrusted, 1).weight, 0) << "front class only";
  EXPECT_EQ(MeasureContour(Profile(-kReach, 0), kTrusted, 1).weight, 0) << "back class only";
  EXPECT_EQ(MeasureContour(Profile(0, 0, 0), kTrusted, 1).weight, 0) << "no edge";
  EXPECT_EQ(MeasureContour(Profile(0, 0), {0, 0.5, 0}, 1).weight, 0) << "no trust";
  ContourProfile turned = Profile(0, 0);
  for (double& gain : turned.front_gain) gain = -gain;
  EXPECT_EQ(MeasureContour(turned, kTrusted, 1).weight, 0) << "classes swapped";
  ContourProfile vague = Profile(0, 0);
  for (double& gain : vague.front_gain) gain *= 0.3;
  EXPECT_EQ(MeasureContour(vague, kTrusted, 1).weight, 0) << "indistinct border";
}

TEST(ContourProfile, WeightGrowsWithTrustAndEdgeContrast) {
  const double full = MeasureContour(Profile(0, 0), kTrusted, 1).weight;
  EXPECT_NEAR(MeasureContour(Profile(0, 0), {0, 0.5, 0.25}, 1).weight, 0.25 * full, 1e-12);
  double last = full;
  for (const double contrast : {0.1, 0.05, 0.02, 0.005}) {
    const double weight = MeasureContour(Profile(0, 0, contrast), kTrusted, 1).weight;
    EXPECT_LT(weight, last);
    last = weight;
  }
  EXPECT_LT(last, 0.1);
}

}  // namespace
}  // namespace tessera
