#include "common/imaging/border_trust.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "common/base/random.h"

namespace tessera {
namespace {

constexpr int kSize_px = 1000, kCell_px = 60, kBlock_px = 26;

// Blocks of class 1 on ground of class 0, each at a random position in its own cell.
LabelImage Blocks(uint64_t seed) {
  Random random(seed);
  LabelImage labels(kSize_px, kSize_px, 1, 0);
  const auto below = [&](int n) { return static_cast<int>(random.Below(n)); };
  const int first_x = below(kCell_px), first_y = below(kCell_px);
  for (int cell_y = first_y; cell_y + kCell_px <= kSize_px; cell_y += kCell_px) {
    for (int cell_x = first_x; cell_x + kCell_px <= kSize_px; cell_x += kCell_px) {
      const int x0 = cell_x + 5 + below(kCell_px - kBlock_px - 10), y0 = cell_y + 5 + below(kCell_px - kBlock_px - 10);
      for (int y = y0; y < y0 + kBlock_px; ++y) {
        for (int x = x0; x < x0 + kBlock_px; ++x) labels.at(x, y) = 1;
      }
    }
  }
  return labels;
}

// Dilates class 1 by `px` along rows and columns; a negative `px` erodes it.
LabelImage Grown(const LabelImage& labels, int px) {
  LabelImage out = labels;
  const uint8_t grows = px > 0 ? 1 : 0;
  for (int y = 0; y < labels.height; ++y) {
    for (int x = 0; x < labels.width; ++x) {
      for (int dy = -std::abs(px); dy <= std::abs(px); ++dy) {
        for (int dx = -std::abs(px); dx <= std::abs(px); ++dx) {
          const int u = x + dx, v = y + dy;
          if (u < 0 || v < 0 || u >= labels.width || v >= labels.height || labels.at(u, v) != grows) continue;
          out.at(x, y) = grows;
        }
      }
    }
  }
  return out;
}

// An image in which blocks are lighter than the ground, with pixel noise.
FloatImage Light(const LabelImage& labels) {
  Random random(7);
  FloatImage image(labels.width, labels.height);
  for (size_t i = 0; i < image.data.size(); ++i) {
    image.data[i] = static_cast<float>(0.35 + 0.2 * labels.data[i] + 0.05 * random.Uniform());
  }
  return image;
}

// Reduces the resolution: each pixel represents step x step pixels.
FloatImage Likely(const LabelImage& labels, double confidence = 0.8, int step = 1) {
  FloatImage image(labels.width / step, labels.height / step, 2);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const int label = labels.at(x * step + step / 2, y * step + step / 2);
      image.at(x, y, label) = static_cast<float>(confidence);
      image.at(x, y, 1 - label) = static_cast<float>(1 - confidence);
    }
  }
  return image;
}

BorderTrusts Measured(const FloatImage& luminance, const FloatImage& likelihoods) {
  BorderCounts counts(2);
  counts.Add(luminance, likelihoods);
  return counts.Trusts();
}

TEST(BorderTrust, MeasuresBorderBias) {
  const LabelImage blocks = Blocks(1);
  const FloatImage light = Light(blocks);
  for (const int off : {-4, -2, 0, 2, 4}) {
    const BorderTrusts trusts = Measured(light, Likely(Grown(blocks, off)));
    // Dilated blocks move the border onto the ground, away from the second class.
    EXPECT_NEAR(trusts.Of(0, 1).bias_px, -off, 0.3) << off;
    EXPECT_LT(trusts.Of(0, 1).sigma_px, 1) << off;
    EXPECT_GT(trusts.Of(0, 1).weight, 0) << off;
    EXPECT_EQ(trusts.Of(1, 0).bias_px, -trusts.Of(0, 1).bias_px);
    EXPECT_EQ(trusts.Of(1, 0).weight, trusts.Of(0, 1).weight);
  }
  EXPECT_GT(Measured(light, Likely(blocks)).Of(0, 1).weight, 0.95);
}

TEST(BorderTrust, WeightDecreasesWithBias) {
  const LabelImage blocks = Blocks(1);
  double last = 1.1;
  for (const int off : {0, 1, 2, 3, 4}) {
    const double weight = Measured(Light(blocks), Likely(Grown(blocks, off))).Of(0, 1).weight;
    EXPECT_LT(weight, last) << off;
    last = weight;
  }
}

TEST(BorderTrust, RandomBordersHaveWeightZero) {
  const FloatImage light = Light(Blocks(1));
  for (const uint64_t seed : {2, 3, 4, 5, 6}) {
    EXPECT_LT(Measured(light, Likely(Blocks(seed))).Of(0, 1).weight, 0.3) << seed;
  }
  const FloatImage flat(kSize_px, kSize_px, 1, 0.5f);
  EXPECT_EQ(Measured(flat, Likely(Blocks(1))).Of(0, 1).weight, 0);
}

TEST(BorderTrust, FewOrUnclearBordersHaveWeightZero) {
  const LabelImage blocks = Blocks(1);
  EXPECT_EQ(Measured(Light(blocks), Likely(blocks, 0.55)).Of(0, 1).weight, 0);
  LabelImage one(kSize_px, kSize_px, 1, 0);
  for (int y = 100; y < 160; ++y) {
    for (int x = 100; x < 160; ++x) one.at(x, y) = 1;
  }
  EXPECT_EQ(Measured(Light(one), Likely(one)).Of(0, 1).weight, 0);
}

// Likelihoods often end at an image edge, which is not a class border.
TEST(BorderTrust, EndOfLikelihoodsIsNotABorder) {
  const LabelImage blocks = Blocks(1);
  const FloatImage light = Light(blocks);
  FloatImage likely = Likely(LabelImage(kSize_px, kSize_px, 1, 1));
  for (size_t i = 0; i < blocks.data.size(); ++i) {
    if (blocks.data[i] == 0) likely.data[i] = likely.data[i + blocks.data.size()] = 0.5f;
  }
  EXPECT_EQ(Measured(light, likely).Of(0, 1).weight, 0);
}

TEST(BorderTrust, InvalidPixelsAreSkipped) {
  const LabelImage blocks = Blocks(1);
  FloatImage light = Light(blocks);
  for (float& value : light.data) value = NAN;
  EXPECT_EQ(Measured(light, Likely(blocks)).Of(0, 1).weight, 0);
}

TEST(BorderTrust, CoarseLikelihoodsUseImagePixels) {
  const LabelImage blocks = Blocks(1);
  const BorderTrusts trusts = Measured(Light(blocks), Likely(Grown(blocks, 3), 0.8, 2));
  EXPECT_NEAR(trusts.Of(0, 1).bias_px, -3, 0.7);
}

TEST(BorderTrust, CountsOfViewsAreAdditive) {
  const LabelImage a = Blocks(1), b = Grown(Blocks(2), 2);
  BorderCounts both(2), first(2), second(2);
  both.Add(Light(a), Likely(a));
  both.Add(Light(Blocks(2)), Likely(b));
  first.Add(Light(a), Likely(a));
  second.Add(Light(Blocks(2)), Likely(b));
  first.Add(second);
  EXPECT_EQ(first.Trusts(), both.Trusts());
  EXPECT_GT(both.Trusts().Of(0, 1).weight, 0);
}

TEST(BorderTrust, CountsRoundTripAsList) {
  const LabelImage blocks = Blocks(1);
  BorderCounts counts(2);
  counts.Add(Light(blocks), Likely(Grown(blocks, 2)));
  std::vector<int64_t> list = counts.ToCounts();
  const auto again = BorderCounts::FromCounts(2, list);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_EQ(again->Trusts(), counts.Trusts());
  EXPECT_GT(again->Trusts().Of(0, 1).weight, 0);
  EXPECT_EQ(again->ToCounts(), list);
  EXPECT_FALSE(BorderCounts::FromCounts(3, list).ok());
  list.back() = -1;
  EXPECT_FALSE(BorderCounts::FromCounts(2, list).ok());
}

TEST(BorderTrust, UnknownClassesHaveWeightZero) {
  EXPECT_EQ(BorderTrusts().Of(0, 1).weight, 0);
  EXPECT_EQ(BorderTrusts(2).Of(0, 2).weight, 0);
  EXPECT_EQ(BorderTrusts(2).Of(-1, 1).weight, 0);
}

}  // namespace
}  // namespace tessera
