#include "worker/photo/texels.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/make_texels.h"

namespace tessera {
namespace {

// Rounded before and after interpolation.
constexpr double kOneStep = 1.0 / Texels::kLikelihoodSteps + 1e-6;

// One plane per class, linear over the unit square that the image shows: class l at (s, t).
double Ramp(int l, double s, double t) { return 0.2 + 0.04 * l + 0.3 * s + 0.1 * t; }

FloatImage Ramps(int width, int height, int classes) {
  FloatImage out(width, height, classes);
  for (int l = 0; l < classes; ++l) {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        out.at(x, y, l) = static_cast<float>(Ramp(l, (x + 0.5) / width, (y + 0.5) / height));
      }
    }
  }
  return out;
}

TEST(Texels, LuminanceIsExactToHalfAStepAndInvalidPixelsAreMarked) {
  FloatImage image(33, 3);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = static_cast<float>(i) / 98;
  image.at(5, 1) = std::nanf("");
  image.at(6, 1) = 1.5f;
  image.at(7, 1) = -1;
  const Texels texels = MakeTexels(image);
  EXPECT_EQ(texels.classes, 0);
  for (int y = 0; y < 3; ++y) {
    for (int x = 0; x < 33; ++x) {
      if (y == 1 && x >= 5 && x <= 7) continue;
      ASSERT_TRUE(texels.Valid(x, y));
      EXPECT_NEAR(texels.Luminance(x, y), image.at(x, y), 0.51 / Texels::kLuminanceSteps);
    }
    for (int x = 33; x < texels.stride; ++x) EXPECT_FALSE(texels.Valid(x, y));
  }
  EXPECT_FALSE(texels.Valid(5, 1));
  EXPECT_EQ(texels.Luminance(6, 1), 1);
  EXPECT_EQ(texels.Luminance(7, 1), 0);
}

TEST(Texels, LikelihoodsOfAnyResolutionAreSampledAtPixelCentres) {
  const FloatImage luminance(48, 36, 1, 0.5f);
  for (int classes : {1, 4, 6, 9}) {
    for (const auto& [width, height] : {std::pair(48, 36), {24, 18}, {12, 9}, {96, 72}, {192, 144}, {31, 40}}) {
      const FloatImage likelihoods = Ramps(width, height, classes);
      const Texels texels = MakeTexels(luminance, likelihoods, ScaleToSize(luminance, likelihoods));
      ASSERT_EQ(texels.classes, classes);
      // Coarser likelihoods repeat their border values, so the outermost half pixels are not linear.
      const int rim = 1 + 48 / width;
      for (int l = 0; l < classes; ++l) {
        for (int y = rim; y < 36 - rim; ++y) {
          for (int x = rim; x < 48 - rim; ++x) {
            ASSERT_NEAR(texels.Likelihood(x, y, l), Ramp(l, (x + 0.5) / 48, (y + 0.5) / 36), kOneStep)
                << width << " " << l << " " << x << " " << y;
          }
        }
      }
    }
  }
}

TEST(Texels, CropEqualsThatPartOfTheWhole) {
  const FloatImage likelihoods = Ramps(40, 30, 2), luminance(16, 12, 1, 0.5f);
  // The crop begins at pixel (20, 8) of an image of 80 x 60.
  const PixelMapping mapping{0.5, 0.5, 10, 4};
  const Texels texels = MakeTexels(luminance, likelihoods, mapping);
  EXPECT_NEAR(texels.Likelihood(3, 5, 1), Ramp(1, 23.5 / 80, 13.5 / 60), kOneStep);
}

TEST(Texels, FinerLikelihoodsAreAveragedOverThePixel) {
  FloatImage likelihoods(16, 16);
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 16; ++x) likelihoods.at(x, y) = (x + y) % 2 == 0 ? 1 : 0;
  }
  const FloatImage luminance(4, 4, 1, 0.5f);
  const Texels texels = MakeTexels(luminance, likelihoods, ScaleToSize(luminance, likelihoods));
  for (int y = 0; y < 4; ++y) {
    for (int x = 0; x < 4; ++x) EXPECT_NEAR(texels.Likelihood(x, y, 0), 0.5, kOneStep);
  }
}

TEST(Texels, CodesOfManyValuesEqualThoseOfOne) {
  std::vector<float> values = {0, -0.0f, 1, -1, 2, 0.5f, std::nanf(""), HUGE_VALF, -HUGE_VALF};
  for (int i = -5; i < 70000; ++i) values.push_back(static_cast<float>(i) / 65534 + 1e-7f);
  const std::vector<uint16_t> codes = LuminanceCodes(values);
  ASSERT_EQ(codes.size(), values.size());
  for (size_t i = 0; i < values.size(); ++i) EXPECT_EQ(codes[i], LuminanceCode(values[i])) << values[i];
  std::erase_if(values, [](float value) { return std::isnan(value); });
  const std::vector<uint8_t> steps = LikelihoodStepsOf(values);
  ASSERT_EQ(steps.size(), values.size());
  for (size_t i = 0; i < values.size(); ++i) EXPECT_EQ(steps[i], LikelihoodStep(values[i])) << values[i];
}

}  // namespace
}  // namespace tessera
