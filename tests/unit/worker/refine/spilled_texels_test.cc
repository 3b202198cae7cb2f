#include "worker/refine/spilled_texels.h"

#include <gtest/gtest.h>

#include "common/base/random.h"

namespace tessera {
namespace {

// A part of an image's texels is the texels of that part of the image.
TEST(SpilledTexels, BringAnyPart) {
  Random random(3);
  FloatImage image(150, 90), likelihoods(150, 90, 6);
  for (float& value : image.data) value = static_cast<float>(random.Uniform());
  for (float& value : likelihoods.data) value = static_cast<float>(random.Uniform());
  const PixelMapping mapping = ScaleToSize(image, likelihoods);
  Texels texels = MakeTexels(image, likelihoods, mapping, 0, 0);
  const auto spilled = SpilledTexels::Spill(testing::TempDir(), &texels);
  ASSERT_TRUE(spilled.ok()) << spilled.status();
  EXPECT_TRUE(texels.luminance.empty());
  EXPECT_EQ(spilled->rect(), (PixelRect{0, 0, 150, 90}));
  for (const PixelRect& rect : {PixelRect{0, 0, 150, 90}, PixelRect{64, 0, 131, 77}, PixelRect{2, 64, 3, 90}}) {
    FloatImage part(rect.width(), rect.height());
    for (int y = 0; y < part.height; ++y) {
      for (int x = 0; x < part.width; ++x) part.at(x, y) = image.at(rect.x0 + x, rect.y0 + y);
    }
    const Texels expected = MakeTexels(part, likelihoods, mapping, rect.x0, rect.y0);
    spilled->Bring(rect, &texels);
    EXPECT_EQ(texels.x0, expected.x0);
    EXPECT_EQ(texels.y0, expected.y0);
    EXPECT_EQ(texels.width, expected.width);
    EXPECT_EQ(texels.height, expected.height);
    EXPECT_EQ(texels.stride, expected.stride);
    EXPECT_EQ(texels.classes, expected.classes);
    EXPECT_EQ(texels.luminance, expected.luminance);
    EXPECT_EQ(texels.likelihoods, expected.likelihoods);
  }
}

}  // namespace
}  // namespace tessera
