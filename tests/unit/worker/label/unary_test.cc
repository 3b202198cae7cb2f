#include "worker/label/unary.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "common/base/random.h"

namespace tessera {
namespace {

constexpr int kClasses = 3;

// A map of the window in which each pixel shows a face of its own.
FaceMap MapOf(const PixelRect& window) {
  FaceMap map;
  map.width = window.width();
  map.height = window.height();
  map.x0 = window.x0;
  map.y0 = window.y0;
  for (int i = 0; i < map.width * map.height; ++i) map.face.push_back(i);
  return map;
}

FaceLikelihoods SumsOf(const FaceMap& map, const std::vector<uint8_t>& steps, int width, int height,
                       const PixelMapping& mapping) {
  FaceLikelihoods sums(map.face.size(), kClasses);
  AddLikelihoods(map, LikelihoodSteps{width, height, steps}, mapping, {}, &sums);
  return sums;
}

// A part that lacks a row or column gives other sums: border values would be repeated.
TEST(SampledPart, GivesTheSumsOfTheWhole) {
  int smaller = 0;
  for (const double scale : {0.25, 0.37, 0.5, 1.0, 1.9}) {
    Random random(static_cast<uint64_t>(100 * scale));
    for (int run = 0; run < 60; ++run) {
      const int width = 1 + static_cast<int>(random.Below(30)), height = 1 + static_cast<int>(random.Below(30));
      std::vector<uint8_t> steps(static_cast<size_t>(kClasses) * width * height);
      for (uint8_t& step : steps) step = static_cast<uint8_t>(random.Below(256));
      PixelMapping mapping;
      mapping.scale_x = scale;
      mapping.scale_y = scale * random.Uniform(0.8, 1.2);
      mapping.offset_x = random.Uniform(-3, 3);
      mapping.offset_y = random.Uniform(-3, 3);
      // Pixels of a whole image are not negative.
      mapping.first_x = static_cast<int>(random.Below(20));
      mapping.first_y = static_cast<int>(random.Below(20));
      // Windows may reach over all borders of the likelihoods.
      const int x0 = static_cast<int>((mapping.first_x - 4 + random.Uniform() * width) / scale),
                y0 = static_cast<int>((mapping.first_y - 4 + random.Uniform() * height) / scale);
      const PixelRect window = {x0, y0, x0 + 1 + static_cast<int>(random.Below(25)),
                                y0 + 1 + static_cast<int>(random.Below(25))};
      const PixelRect part = SampledPart(window, mapping, width, height);
      ASSERT_TRUE((PixelRect{0, 0, width, height}).Contains(part) && !part.empty());
      EXPECT_LE(part.width(), scale * window.width() + 3);
      smaller += part.area() < width * height;
      std::vector<uint8_t> copied;
      for (int c = 0; c < kClasses; ++c) {
        for (int y = part.y0; y < part.y1; ++y) {
          const auto row = steps.begin() + (static_cast<ptrdiff_t>(c) * height + y) * width;
          copied.insert(copied.end(), row + part.x0, row + part.x1);
        }
      }
      PixelMapping moved = mapping;
      moved.first_x += part.x0;
      moved.first_y += part.y0;
      const FaceMap map = MapOf(window);
      const FaceLikelihoods whole = SumsOf(map, steps, width, height, mapping);
      const FaceLikelihoods sums = SumsOf(map, copied, part.width(), part.height(), moved);
      ASSERT_EQ(sums.sum, whole.sum) << "scale " << scale << ", run " << run;
      ASSERT_EQ(sums.pixels, whole.pixels);
    }
  }
  EXPECT_GT(smaller, 100);
}

}  // namespace
}  // namespace tessera
