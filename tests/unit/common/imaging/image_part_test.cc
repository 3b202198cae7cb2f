// Parts of images and likelihoods are bit-identical to the same part of the whole.
#include <gtest/gtest.h>
#include <tiffio.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>

#include "common/base/random.h"
#include "common/imaging/image_io.h"
#include "common/imaging/undistort.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

constexpr int kWidth = 173, kHeight = 131, kClasses = 3;
const ImagePart kParts[] = {{0, 0, 1, 1},
                            {0, 0, kWidth, kHeight},
                            {64, 64, 128, 128},
                            {64, 0, kWidth, 64},
                            {100, 37, 101, 99},
                            {128, 64, kWidth, kHeight},
                            {kWidth - 1, kHeight - 1, kWidth, kHeight}};

LensModel Lens(double k1, double p1) {
  LensModel lens;
  lens.kind = k1 == 0 && p1 == 0 ? LensModel::Kind::kPinhole : LensModel::Kind::kOpenCv;
  lens.pinhole = {kWidth, kHeight, 150, 155, 0.48 * kWidth, 0.53 * kHeight};
  lens.coefficients[0] = k1;
  lens.coefficients[2] = p1;
  return lens;
}

const LensModel kLenses[] = {Lens(0, 0), Lens(-0.2, 0.01), Lens(0.4, 0), Lens(-1.5, 0)};

ByteImage RandomPart(int width, int height, int channels) {
  Random random(3);
  ByteImage image(width, height, channels);
  for (uint8_t& value : image.data) value = static_cast<uint8_t>(1 + random.Below(255));
  return image;
}

// Compares bits, because pixels outside the photograph are NaN.
void ExpectEqualsPart(const FloatImage& part, const FloatImage& whole, int x0, int y0) {
  for (int c = 0; c < part.channels; ++c) {
    for (int y = 0; y < part.height; ++y) {
      ASSERT_EQ(std::memcmp(&part.at(0, y, c), &whole.at(x0, y0 + y, c), sizeof(float) * part.width), 0)
          << "channel " << c << ", row " << y << " of the part at " << x0 << ", " << y0;
    }
  }
}

TEST(ImagePartTest, OfLuminance) {
  const std::string folder = FreshTestFolder("f");
  ASSERT_TRUE(WriteJpeg(folder + "/a.jpg", RandomPart(kWidth, kHeight, 3), 90).ok());
  ASSERT_TRUE(WritePng(folder + "/a.png", RandomPart(kWidth, kHeight, 1)).ok());
  for (const char* name : {"/a.jpg", "/a.png"}) {
    for (const LensModel& lens : kLenses) {
      const auto whole = ReadLuminance(folder + name, lens);
      ASSERT_TRUE(whole.ok()) << whole.status();
      for (const ImagePart& part : kParts) {
        const auto read = ReadLuminancePart(folder + name, lens, part);
        ASSERT_TRUE(read.ok()) << read.status();
        ASSERT_EQ(read->width, part.width());
        ASSERT_EQ(read->height, part.height());
        ExpectEqualsPart(*read, *whole, part.x0, part.y0);
      }
    }
  }
  EXPECT_FALSE(ReadLuminancePart(folder + "/a.png", kLenses[0], {0, 0, kWidth + 1, 4}).ok());
  EXPECT_FALSE(ReadLuminancePart(folder + "/a.png", kLenses[0], {5, 0, 5, 4}).ok());
}

TEST(ImagePartTest, OfColours) {
  const std::string folder = FreshTestFolder("f");
  const ByteImage pixels = RandomPart(kWidth, kHeight, 3);
  ASSERT_TRUE(WritePng(folder + "/a.png", pixels).ok());
  for (const LensModel& lens : kLenses) {
    const auto whole = ReadColorPart(folder + "/a.png", lens, {0, 0, kWidth, kHeight});
    const auto luminance = ReadLuminance(folder + "/a.png", lens);
    ASSERT_TRUE(whole.ok() && luminance.ok()) << whole.status();
    for (const ImagePart& part : kParts) {
      const auto read = ReadColorPart(folder + "/a.png", lens, part);
      ASSERT_TRUE(read.ok()) << read.status();
      ASSERT_EQ(read->channels, 3);
      ExpectEqualsPart(*read, *whole, part.x0, part.y0);
    }
    for (int i = 0; i < kWidth * kHeight; ++i) {
      const float sum = 0.299f * whole->plane(0)[i] + 0.587f * whole->plane(1)[i] + 0.114f * whole->plane(2)[i];
      EXPECT_EQ(std::isnan(sum), std::isnan(luminance->data[i]));
      if (!std::isnan(sum)) {
        EXPECT_NEAR(sum, luminance->data[i], 1e-5);
      }
    }
    if (lens.kind == LensModel::Kind::kPinhole) {
      EXPECT_FLOAT_EQ(whole->at(3, 2, 2), pixels.at(3, 2, 2) / 255.f);
    }
  }
}

// Compares a part with the whole, at any resolution of the file.
void CheckLikelihoods(const std::string& path) {
  for (const LensModel& lens : kLenses) {
    const auto whole = ReadLikelihoods(path, kClasses, lens);
    ASSERT_TRUE(whole.ok()) << whole.status();
    for (const ImagePart& part : kParts) {
      const auto read = ReadLikelihoodPart(path, kClasses, lens, part);
      ASSERT_TRUE(read.ok()) << read.status();
      EXPECT_EQ(read->whole_width, whole->width);
      EXPECT_EQ(read->whole_height, whole->height);
      const auto extent = ReadLikelihoodExtent(path, kClasses, lens, part);
      ASSERT_TRUE(extent.ok()) << extent.status();
      EXPECT_EQ(extent->whole_width, whole->width);
      EXPECT_EQ(extent->whole_height, whole->height);
      EXPECT_EQ(extent->part,
                (ImagePart{read->x0, read->y0, read->x0 + read->pixels.width, read->y0 + read->pixels.height}));
      ExpectEqualsPart(read->pixels, *whole, read->x0, read->y0);
      if (whole->width == kWidth) {
        EXPECT_EQ(read->pixels.width, part.width());
        EXPECT_EQ(read->pixels.height, part.height());
        continue;
      }
      // All pixels over the part, and one more pixel for interpolation where available.
      const double sx = static_cast<double>(whole->width) / kWidth, sy = static_cast<double>(whole->height) / kHeight;
      EXPECT_LE(read->x0, std::max(0.0, part.x0 * sx - 1));
      EXPECT_LE(read->y0, std::max(0.0, part.y0 * sy - 1));
      EXPECT_GE(read->x0 + read->pixels.width, std::min<double>(whole->width, part.x1 * sx + 1));
      EXPECT_GE(read->y0 + read->pixels.height, std::min<double>(whole->height, part.y1 * sy + 1));
    }
  }
}

TEST(ImagePartTest, OfLikelihoodsInStrips) {
  const std::string path = FreshTestFolder("f") + "/a.tif";
  ASSERT_TRUE(WriteLikelihoodTiff(path, RandomPart(kWidth, kHeight, kClasses)).ok());
  CheckLikelihoods(path);
}

TEST(ImagePartTest, LikelihoodsAreDividedByTheirSumInDoublePrecision) {
  const std::string path = FreshTestFolder("f") + "/a.tif";
  ByteImage stored = RandomPart(kWidth, kHeight, kClasses);
  for (int c = 0; c < kClasses; ++c) stored.at(100, 50, c) = 0;
  ASSERT_TRUE(WriteLikelihoodTiff(path, stored).ok());
  const auto read = ReadLikelihoods(path, kClasses, kLenses[0]);
  ASSERT_TRUE(read.ok()) << read.status();
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      double sum = 0;
      for (int c = 0; c < kClasses; ++c) sum += stored.at(x, y, c);
      for (int c = 0; c < kClasses; ++c) {
        const double share = sum > 0 ? stored.at(x, y, c) / sum : 1.0 / kClasses;
        ASSERT_EQ(read->at(x, y, c), static_cast<float>(share)) << x << ", " << y;
      }
    }
  }
}

std::string NpyBytes(const std::string& header, const void* values, size_t size_bytes) {
  std::string npy("\x93NUMPY\x01\x00", 8);
  npy += static_cast<char>(header.size());
  npy += '\0';
  return npy + header + std::string(static_cast<const char*>(values), size_bytes);
}

TEST(ImagePartTest, NamesTheFirstPixelThatIsNoLikelihood) {
  const std::string path = FreshTestFolder("f") + "/a.npy";
  for (const float wrong : {-0.5f, std::nanf(""), HUGE_VALF}) {
    std::vector<float> values(kClasses * kWidth * kHeight, 0.25f);
    const auto at = [&](int c, int y, int x) -> float& { return values[(c * kHeight + y) * kWidth + x]; };
    at(1, 99, 7) = at(1, 99, 8) = at(1, 120, 0) = at(2, 0, 0) = wrong;
    WriteText(path, NpyBytes("{'descr': '<f4', 'fortran_order': False, 'shape': (3, 131, 173), }", values.data(),
                             values.size() * sizeof(float)));
    const auto read = ReadLikelihoods(path, kClasses, kLenses[0]);
    EXPECT_NE(read.status().message().find("class 1, pixel (7, 99)"), std::string::npos) << read.status();
  }
}

TEST(ImagePartTest, ExtentsOfArraysOfOtherForms) {
  const std::string path = FreshTestFolder("f") + "/a.npy";
  const std::vector<uint8_t> values(kClasses * kWidth * kHeight, 1);
  WriteText(path, NpyBytes("{'descr': '|u1', 'fortran_order': False, 'shape': (131, 173, 3), }", values.data(),
                           values.size()));
  CheckLikelihoods(path);
  WriteText(path, NpyBytes("{'descr': '|u1', 'fortran_order': False, 'shape': (131, 173), }", values.data(),
                           kWidth * kHeight));
  CheckLikelihoods(path);
  // A header that is longer than what is read of the file first.
  const std::string header =
      "{'descr': '|u1', 'fortran_order': False, 'shape': (3, 131, 173), }" + std::string(size_t{1} << 18, ' ');
  const auto length = static_cast<uint32_t>(header.size());
  const std::string begin("\x93NUMPY\x02\x00", 8), size(reinterpret_cast<const char*>(&length), 4);
  WriteText(path, begin + size + header + std::string(values.begin(), values.end()));
  CheckLikelihoods(path);
  WriteText(path, begin + size + header);
  EXPECT_FALSE(ReadLikelihoodExtent(path, kClasses, kLenses[0], kParts[0]).ok());
}

TEST(ImagePartTest, OfCoarserLikelihoods) {
  const std::string path = FreshTestFolder("f") + "/a.tif";
  ASSERT_TRUE(WriteLikelihoodTiff(path, RandomPart(kWidth / 2, kHeight / 2, kClasses)).ok());
  CheckLikelihoods(path);
}

TEST(ImagePartTest, OfLikelihoodsInTiles) {
  const std::string path = FreshTestFolder("f") + "/a.tif";
  const ByteImage image = RandomPart(kWidth, kHeight, kClasses);
  TIFF* tiff = TIFFOpen(path.c_str(), "w");
  ASSERT_NE(tiff, nullptr);
  constexpr int kTile = 48;
  for (int page = 0; page < kClasses; ++page) {
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, kWidth);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, kHeight);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 8);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_LZW);
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, kTile);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, kTile);
    for (int y0 = 0; y0 < kHeight; y0 += kTile) {
      for (int x0 = 0; x0 < kWidth; x0 += kTile) {
        std::vector<uint8_t> tile(kTile * kTile, 0);
        for (int y = y0; y < std::min(kHeight, y0 + kTile); ++y) {
          for (int x = x0; x < std::min(kWidth, x0 + kTile); ++x) {
            tile[(y - y0) * kTile + x - x0] = image.at(x, y, page);
          }
        }
        ASSERT_GE(TIFFWriteTile(tiff, tile.data(), x0, y0, 0, 0), 0);
      }
    }
    TIFFWriteDirectory(tiff);
  }
  TIFFClose(tiff);
  CheckLikelihoods(path);
}

TEST(ImagePartTest, OfLikelihoodsInAnArray) {
  const std::string path = FreshTestFolder("f") + "/a.npy";
  const ByteImage image = RandomPart(kWidth, kHeight, kClasses);
  WriteText(path, NpyBytes("{'descr': '|u1', 'fortran_order': False, 'shape': (3, 131, 173), }", image.data.data(),
                           image.data.size()));
  CheckLikelihoods(path);
}

TEST(ImagePartTest, OfLabelImages) {
  const std::string path = FreshTestFolder("f") + "/a.png";
  ByteImage image = RandomPart(kWidth, kHeight, 1);
  for (uint8_t& label : image.data) label %= kClasses;
  ASSERT_TRUE(WritePng(path, image).ok());
  CheckLikelihoods(path);
}

}  // namespace
}  // namespace tessera
