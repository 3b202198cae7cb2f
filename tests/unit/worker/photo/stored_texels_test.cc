#include "worker/photo/stored_texels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstring>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "tests/support/held_pixels.h"
#include "tests/support/make_texels.h"

namespace tessera {
namespace {

FloatImage RandomImage(Random& random, int width, int height, int channels) {
  FloatImage image(width, height, channels);
  for (float& value : image.data) value = static_cast<float>(random.Uniform());
  return image;
}

FloatImage PartOf(const FloatImage& image, const PixelRect& rect) {
  FloatImage part(rect.width(), rect.height(), image.channels);
  for (int l = 0; l < image.channels; ++l) {
    for (int y = 0; y < part.height; ++y) {
      for (int x = 0; x < part.width; ++x) part.at(x, y, l) = image.at(rect.x0 + x, rect.y0 + y, l);
    }
  }
  return part;
}

// A window is independent of other windows and of the pixel origin, and invalid where nothing is stored.
TEST(StoredTexels, LoadsAnyWindow) {
  Random random(3);
  for (const int classes : {0, 1, 2, 3, 4, 6, 8}) {
    for (const bool coarse : {false, true}) {
      const FloatImage image = RandomImage(random, 150, 90, 1);
      const FloatImage likelihoods =
          classes == 0 ? FloatImage() : RandomImage(random, coarse ? 75 : 150, coarse ? 30 : 90, classes);
      const HeldPixels pixels(image, likelihoods);
      const StoredTexels stored = *pixels.Level(0);
      EXPECT_EQ(stored.same_resolution, classes > 0 && !coarse);
      const Texels whole = MakeTexels(image, likelihoods, stored.mapping);
      Texels texels;
      for (const PixelRect& rect : {PixelRect{0, 0, 150, 90}, PixelRect{64, 0, 131, 77}, PixelRect{2, 64, 3, 90},
                                    PixelRect{-8, -64, 20, 12}, PixelRect{140, 80, 160, 100}}) {
        const int shift_x = 2 * static_cast<int>(random.Below(40)), shift_y = 2 * static_cast<int>(random.Below(40));
        stored.WithOrigin(shift_x, shift_y)
            .LoadWindow({rect.x0 - shift_x, rect.y0 - shift_y, rect.x1 - shift_x, rect.y1 - shift_y}, &texels);
        ASSERT_EQ(texels.width, rect.width());
        ASSERT_EQ(texels.height, rect.height());
        ASSERT_EQ(texels.x0, rect.x0 - shift_x);
        ASSERT_EQ(texels.y0, rect.y0 - shift_y);
        ASSERT_EQ(texels.classes, classes);
        ASSERT_EQ(texels.luminance.size(), static_cast<size_t>(texels.stride) * (texels.height + 1));
        for (int y = 0; y <= texels.height; ++y) {
          for (int x = 0; x < texels.stride; ++x) {
            const int from_x = rect.x0 + x, from_y = rect.y0 + y;
            const bool inside =
                x < texels.width && y < texels.height && from_x >= 0 && from_y >= 0 && from_x < 150 && from_y < 90;
            ASSERT_EQ(texels.luminance[texels.Index(x, y)], inside ? whole.luminance[whole.Index(from_x, from_y)] : 0);
            for (int l = 0; inside && l < classes; ++l) {
              ASSERT_EQ(texels.Likelihood(x, y, l), whole.Likelihood(from_x, from_y, l)) << coarse << classes;
            }
          }
        }
      }
    }
  }
}

// Several threads load a tall window in parts: the rows are those of low windows.
TEST(StoredTexels, LoadsTallWindowsInParts) {
  Random random(4);
  for (const int threads : {1, 4}) {
    const ThreadLimit limit(threads);
    for (const int classes : {0, 3, 6}) {
      for (const int scale : {1, 2}) {
        const FloatImage image = RandomImage(random, 40, 700, 1);
        const HeldPixels pixels(image,
                                classes == 0 ? FloatImage() : RandomImage(random, 40 / scale, 700 / scale, classes));
        const StoredTexels stored = *pixels.Level(0);
        Texels tall, low, cropped;
        stored.LoadWindow({-2, -10, 44, 710}, &tall);
        tall.CropTo(4, -8, 30, 712, &cropped);
        for (int y = -10; y < 710; y += 24) {
          stored.LoadWindow({-2, y, 44, y + 24}, &low);
          for (int row = 0; row < 24; ++row) {
            for (int x = 0; x < tall.stride; ++x) {
              const size_t at = tall.Index(x, y + 10 + row), at_low = low.Index(x, row);
              ASSERT_EQ(tall.luminance[at], low.luminance[at_low]) << x << " " << y + row;
              for (size_t p = 0; p < tall.likelihoods.size(); ++p) {
                ASSERT_EQ(tall.likelihoods[p][at], low.likelihoods[p][at_low]) << x << " " << y + row;
              }
            }
          }
        }
        stored.LoadWindow({4, -8, 34, 704}, &low);
        EXPECT_EQ(cropped.luminance, low.luminance);
        EXPECT_EQ(cropped.likelihoods, low.likelihoods);
        for (int x = 0; x < tall.stride; ++x) ASSERT_EQ(tall.luminance[tall.Index(x, 720)], 0) << "the spare row";
      }
    }
  }
}

// Copied pixels are those that are mapped; where a copy fails, the mapped ones are read.
TEST(StoredTexels, LoadsCopiedPixelsInBands) {
  Random random(5);
  for (const bool fails : {false, true}) {
    for (const int classes : {0, 3, 6}) {
      const FloatImage image = RandomImage(random, 1500, 690, 1);
      const HeldPixels pixels(image, classes == 0 ? FloatImage() : RandomImage(random, 1500, 690, classes));
      StoredTexels stored = *pixels.Level(0);
      Texels mapped, copied;
      const PixelRect window = {-2, 6, 1400, 700};
      stored.LoadWindow(window, &mapped);
      std::atomic<int64_t> copies = 0, too_large = 0, released = 0;
      stored.copy = [&](const void* from, size_t size_bytes, void* to) {
        ++copies;
        too_large += size_bytes > 1 << 18;
        if (fails) return false;
        std::memcpy(to, from, size_bytes);
        return true;
      };
      stored.release = [&] { ++released; };
      stored.LoadWindow(window, &copied);
      EXPECT_EQ(copied.luminance, mapped.luminance);
      EXPECT_EQ(copied.likelihoods, mapped.likelihoods);
      EXPECT_GT(copies, 0);
      EXPECT_EQ(too_large, 0) << "copies stay in the cache";
      EXPECT_EQ(released, 0) << "no pages were mapped";
    }
  }
}

// A part of loaded texels has the bytes of a load of that part, padding and spare row included.
TEST(Texels, CropEqualsTheLoadedPart) {
  Random random(6);
  for (const int scale : {1, 2}) {
    for (const int classes : {0, 3, 6}) {
      const FloatImage image = RandomImage(random, 130, 90, 1);
      const HeldPixels pixels(
          image, classes == 0 ? FloatImage() : RandomImage(random, 130 / scale, 90 / scale, classes));
      const StoredTexels stored = *pixels.Level(0);
      Texels wide, part, cropped;
      stored.LoadWindow({-4, -2, 140, 96}, &wide);
      for (const PixelRect& window : {PixelRect{-4, 10, 37, 53}, PixelRect{64, -2, 140, 96}, PixelRect{20, 30, 20, 30}}) {
        stored.LoadWindow(window, &part);
        wide.CropTo(window.x0, window.y0, window.width(), window.height(), &cropped);
        EXPECT_EQ(cropped.luminance, part.luminance);
        EXPECT_EQ(cropped.likelihoods, part.likelihoods);
        EXPECT_EQ(cropped.stride, part.stride);
        EXPECT_EQ(cropped.classes, part.classes);
      }
    }
  }
}

TEST(StoredTexels, NextLevelIsTheMeanOfFourPixels) {
  Random random(5);
  FloatImage image = RandomImage(random, 31, 22, 1);
  image.at(7, 9) = std::nanf("");
  const FloatImage likelihoods = RandomImage(random, 31, 22, 3);
  const HeldPixels pixels(image, likelihoods);
  const StoredTexels half = *pixels.Level(1);
  ASSERT_EQ(half.rect, (PixelRect{0, 0, 15, 11}));
  for (int y = 0; y < 11; ++y) {
    for (int x = 0; x < 15; ++x) {
      const uint16_t code = half.luminance[y * 15 + x];
      ASSERT_EQ(code == 0, x == 3 && y == 4);
      const auto mean = [&](const FloatImage& of, int l) {
        return 0.25 * (of.at(2 * x, 2 * y, l) + of.at(2 * x + 1, 2 * y, l) + of.at(2 * x, 2 * y + 1, l) +
                       of.at(2 * x + 1, 2 * y + 1, l));
      };
      if (code != 0) {
        ASSERT_NEAR((code - 1) / Texels::kLuminanceSteps, mean(image, 0), 1.01 / Texels::kLuminanceSteps);
      }
      for (int l = 0; l < 3; ++l) {
        ASSERT_NEAR(half.likelihoods[(l * 11 + y) * 15 + x] / Texels::kLikelihoodSteps, mean(likelihoods, l),
                    1.01 / Texels::kLikelihoodSteps);
      }
    }
  }
}

// The levels of a part equal those of the whole image, wherever the part begins.
TEST(StoredTexels, LevelsOfAPartEqualThoseOfTheWhole) {
  Random random(7);
  const FloatImage image = RandomImage(random, 123, 77, 1), likelihoods = RandomImage(random, 123, 77, 5);
  const HeldPixels whole(image, likelihoods);
  int compared = 0;
  for (int i = 0; i < 30; ++i) {
    PixelRect rect;
    rect.x0 = static_cast<int>(random.Below(60));
    rect.y0 = static_cast<int>(random.Below(40));
    rect.x1 = rect.x0 + 1 + static_cast<int>(random.Below(123 - rect.x0));
    rect.y1 = rect.y0 + 1 + static_cast<int>(random.Below(77 - rect.y0));
    StoredTexels part = *whole.Level(0);
    const HeldPixels cut(PartOf(image, rect), PartOf(likelihoods, rect));
    std::vector<uint16_t> luminance(cut.Level(0)->luminance.begin(), cut.Level(0)->luminance.end());
    std::vector<uint8_t> steps(cut.Level(0)->likelihoods.begin(), cut.Level(0)->likelihoods.end());
    part.rect = rect;
    part.likelihood_width = rect.width();
    part.likelihood_height = rect.height();
    part.mapping.first_x = rect.x0;
    part.mapping.first_y = rect.y0;
    for (int level = 0; level < kTexelLevels; ++level) {
      part.luminance = luminance;
      part.likelihoods = steps;
      const StoredTexels all = *whole.Level(level);
      for (int y = part.rect.y0; y < part.rect.y1; ++y) {
        for (int x = part.rect.x0; x < part.rect.x1; ++x) {
          const size_t at = static_cast<size_t>(y - part.rect.y0) * part.rect.width() + (x - part.rect.x0);
          const size_t in_all = static_cast<size_t>(y) * all.rect.width() + x;
          ASSERT_EQ(part.luminance[at], all.luminance[in_all]);
          for (int l = 0; l < 5; ++l) {
            ASSERT_EQ(part.likelihoods[l * part.pixels() + at], all.likelihoods[l * all.pixels() + in_all]);
          }
          ++compared;
        }
      }
      std::vector<uint16_t> half_luminance = part.HalfLuminance();
      std::vector<uint8_t> half_steps = part.HalfLikelihoods();
      static_cast<TexelShape&>(part) = part.Half();
      luminance = std::move(half_luminance);
      steps = std::move(half_steps);
    }
  }
  EXPECT_GT(compared, 10000);
}

}  // namespace
}  // namespace tessera
