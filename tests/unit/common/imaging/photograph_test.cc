// Photographs as other programs write them: alpha, masks, ranges, tags, and what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tiffio.h>

#include <cmath>
#include <cstring>
#include <opencv2/imgcodecs.hpp>

#include "common/base/random.h"
#include "common/imaging/image_header.h"
#include "common/imaging/image_io.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::HasSubstr;

constexpr int kWide = 37, kHigh = 23;

LensModel LensOfSize(int width, int height) {
  LensModel lens;
  lens.pinhole = {width, height, 60, 60, width / 2.0, height / 2.0};
  return lens;
}

cv::Mat RandomMat(int type) {
  cv::Mat mat(kHigh, kWide, type);
  Random random(5);
  for (int y = 0; y < mat.rows; ++y) {
    for (size_t i = 0; i < mat.cols * mat.elemSize(); ++i) mat.ptr(y)[i] = static_cast<uint8_t>(random.Below(256));
  }
  return mat;
}

std::string Encoded(const std::string& extension, const cv::Mat& mat) {
  std::vector<uint8_t> bytes;
  EXPECT_TRUE(cv::imencode(extension, mat, bytes));
  return {bytes.begin(), bytes.end()};
}

cv::Mat OpenCvPixels(const std::string& bytes, int flags) {
  return cv::imdecode(std::vector<uint8_t>(bytes.begin(), bytes.end()), flags | cv::IMREAD_IGNORE_ORIENTATION);
}

struct TiffFields {
  int samples = 3, bits = 8, format = SAMPLEFORMAT_UINT, orientation = 0, extra = -1, tile = 0, highest = 0;
};

// Writes bytes of random pixels and returns them, row after row.
std::vector<uint8_t> WriteTiff(const std::string& path, const TiffFields& fields) {
  TIFF* tiff = TIFFOpen(path.c_str(), "w");
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, kWide);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, kHigh);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, fields.bits);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, fields.samples);
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, fields.format);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, fields.samples < 3 ? PHOTOMETRIC_MINISBLACK : PHOTOMETRIC_RGB);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_LZW);
  if (fields.orientation > 0) TIFFSetField(tiff, TIFFTAG_ORIENTATION, fields.orientation);
  if (fields.highest > 0) TIFFSetField(tiff, TIFFTAG_MAXSAMPLEVALUE, fields.highest);
  const int extra = fields.samples - (fields.samples < 3 ? 1 : 3);
  const std::vector<uint16_t> kinds(std::max(extra, 1), static_cast<uint16_t>(std::max(fields.extra, 0)));
  if (extra > 0) TIFFSetField(tiff, TIFFTAG_EXTRASAMPLES, extra, kinds.data());
  const size_t pixel = fields.samples * fields.bits / 8, row = kWide * pixel;
  std::vector<uint8_t> bytes(row * kHigh);
  Random random(7);
  for (uint8_t& byte : bytes) byte = static_cast<uint8_t>(random.Below(256));
  if (fields.tile > 0) {
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, fields.tile);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, fields.tile);
    std::vector<uint8_t> tile(fields.tile * fields.tile * pixel);
    for (int y0 = 0; y0 < kHigh; y0 += fields.tile) {
      for (int x0 = 0; x0 < kWide; x0 += fields.tile) {
        for (int y = y0; y < std::min(kHigh, y0 + fields.tile); ++y) {
          std::memcpy(&tile[(y - y0) * fields.tile * pixel], &bytes[y * row + x0 * pixel],
                      std::min(fields.tile, kWide - x0) * pixel);
        }
        TIFFWriteTile(tiff, tile.data(), x0, y0, 0, 0);
      }
    }
  } else {
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 5);
    std::vector<uint8_t> copy;
    for (int y = 0; y < kHigh; ++y) {
      copy.assign(bytes.begin() + static_cast<std::ptrdiff_t>(y * row),
                  bytes.begin() + static_cast<std::ptrdiff_t>((y + 1) * row));
      TIFFWriteScanline(tiff, copy.data(), y);
    }
  }
  TIFFClose(tiff);
  return bytes;
}

FloatImage LuminanceAt(const std::string& path, const PhotographOptions& options = {}) {
  const StatusOr<FloatImage> image = ReadLuminance(path, LensOfSize(kWide, kHigh), options);
  EXPECT_TRUE(image.ok()) << image.status();
  return image.ok() ? *image : FloatImage(kWide, kHigh);
}

float LuminanceOf(float r, float g, float b, float white) {
  return (1.0f / white) * (0.299f * r + 0.587f * g + 0.114f * b);
}

// The pixels are those of OpenCV, byte for byte, for images without alpha.
TEST(PhotographTest, HasThePixelsOfOpenCv) {
  const std::string folder = FreshTestFolder("f");
  for (const char* extension : {".png", ".tif"}) {
    for (const int type : {CV_8UC1, CV_8UC3, CV_16UC1, CV_16UC3}) {
      const std::string path = folder + "/a" + extension;
      const std::string bytes = Encoded(extension, RandomMat(type));
      WriteText(path, bytes);
      const cv::Mat expected = OpenCvPixels(bytes, cv::IMREAD_COLOR | cv::IMREAD_ANYDEPTH);
      const FloatImage luminance = LuminanceAt(path);
      const StatusOr<ByteImage> rgb = ReadRgb(path);
      ASSERT_TRUE(rgb.ok()) << rgb.status();
      const cv::Mat expected_rgb = OpenCvPixels(bytes, cv::IMREAD_COLOR);
      for (int y = 0; y < kHigh; ++y) {
        for (int x = 0; x < kWide; ++x) {
          const bool wide = expected.depth() == CV_16U;
          const cv::Vec3f bgr =
              wide ? cv::Vec3f(expected.at<cv::Vec3w>(y, x)) : cv::Vec3f(expected.at<cv::Vec3b>(y, x));
          ASSERT_EQ(luminance.at(x, y), LuminanceOf(bgr[2], bgr[1], bgr[0], wide ? 65535 : 255)) << extension << type;
          for (int c = 0; c < 3; ++c) {
            ASSERT_EQ(rgb->at(x, y, c), expected_rgb.at<cv::Vec3b>(y, x)[2 - c]) << extension << type;
          }
        }
      }
    }
  }
}

TEST(PhotographTest, TransparentPixelsHaveNoLuminance) {
  const std::string path = FreshTestFolder("f") + "/a.png";
  cv::Mat mat = RandomMat(CV_8UC4);
  for (int y = 0; y < kHigh; ++y) {
    for (int x = 0; x < kWide; ++x) mat.at<cv::Vec4b>(y, x)[3] = 255;
  }
  WriteText(path, Encoded(".png", mat));
  EXPECT_TRUE(ReadImageHeader(path)->has_alpha);
  const FloatImage opaque = LuminanceAt(path);
  mat.at<cv::Vec4b>(3, 5)[3] = 0;
  mat.at<cv::Vec4b>(3, 6)[3] = 1;
  WriteText(path, Encoded(".png", mat));
  const FloatImage image = LuminanceAt(path);
  for (int y = 0; y < kHigh; ++y) {
    for (int x = 0; x < kWide; ++x) {
      const cv::Vec4b p = mat.at<cv::Vec4b>(y, x);
      EXPECT_EQ(opaque.at(x, y), LuminanceOf(p[2], p[1], p[0], 255));
      if (x == 5 && y == 3) {
        EXPECT_TRUE(std::isnan(image.at(x, y)));
      } else {
        EXPECT_EQ(image.at(x, y), opaque.at(x, y));
      }
    }
  }
}

TEST(PhotographTest, TheFourthBandOfATiffIsAlphaIfTheFileSaysSo) {
  const std::string path = FreshTestFolder("f") + "/a.tif";
  for (const int bits : {8, 16}) {
    for (const int tile : {0, 16}) {
      for (const int extra : {EXTRASAMPLE_UNSPECIFIED, EXTRASAMPLE_ASSOCALPHA, EXTRASAMPLE_UNASSALPHA}) {
        TiffFields fields;
        fields.samples = 4;
        fields.bits = bits;
        fields.extra = extra;
        fields.tile = tile;
        const std::vector<uint8_t> bytes = WriteTiff(path, fields);
        EXPECT_EQ(ReadImageHeader(path)->has_alpha, extra != EXTRASAMPLE_UNSPECIFIED);
        const FloatImage image = LuminanceAt(path);
        int64_t masked = 0;
        for (size_t i = 0; i < image.data.size(); ++i) {
          uint16_t p[4] = {};
          for (size_t c = 0; c < 4; ++c) {
            if (bits == 16) std::memcpy(&p[c], &bytes[(4 * i + c) * 2], 2);
            if (bits == 8) p[c] = bytes[4 * i + c];
          }
          const bool transparent = p[3] == 0 && extra != EXTRASAMPLE_UNSPECIFIED;
          masked += transparent;
          if (transparent) {
            ASSERT_TRUE(std::isnan(image.data[i]));
          } else {
            ASSERT_EQ(image.data[i], LuminanceOf(p[0], p[1], p[2], bits == 8 ? 255 : 65535));
          }
        }
        EXPECT_EQ(masked > 0, bits == 8 && extra != EXTRASAMPLE_UNSPECIFIED);
      }
    }
  }
}

TEST(PhotographTest, BlackPixelsOfAMaskHaveNoLuminance) {
  const std::string folder = FreshTestFolder("f"), path = folder + "/a.png", mask = folder + "/m.png";
  cv::Mat photograph(24, 36, CV_8UC3, cv::Scalar(10, 20, 30));
  WriteText(path, Encoded(".png", photograph));
  LensModel lens = LensOfSize(36, 24);
  for (const int factor : {1, 2}) {
    cv::Mat pixels(24 / factor, 36 / factor, CV_8UC1, cv::Scalar(1));
    pixels(cv::Rect(4 / factor, 6 / factor, 8 / factor, 2 / factor)) = 0;
    WriteText(mask, Encoded(".png", pixels));
    const StatusOr<FloatImage> image = ReadLuminance(path, lens, {mask});
    ASSERT_TRUE(image.ok()) << image.status();
    for (int y = 0; y < 24; ++y) {
      for (int x = 0; x < 36; ++x) {
        EXPECT_EQ(std::isnan(image->at(x, y)), x >= 4 && x < 12 && y >= 6 && y < 8) << x << ", " << y;
      }
    }
  }
  // Undistorted pixels next to a masked one have none either, and a part equals that part of the whole.
  lens.kind = LensModel::Kind::kRadial;
  lens.coefficients[0] = -0.1;
  const StatusOr<FloatImage> whole = ReadLuminance(path, lens, {mask});
  const ImagePart rect = {3, 5, 20, 15};
  const StatusOr<FloatImage> part = ReadLuminancePart(path, lens, rect, {mask});
  ASSERT_TRUE(whole.ok() && part.ok());
  int64_t masked = 0;
  for (int y = rect.y0; y < rect.y1; ++y) {
    for (int x = rect.x0; x < rect.x1; ++x) {
      const float a = whole->at(x, y), b = part->at(x - rect.x0, y - rect.y0);
      EXPECT_EQ(std::memcmp(&a, &b, sizeof a), 0);
      masked += std::isnan(a);
    }
  }
  EXPECT_GT(masked, 16);

  WriteText(mask, Encoded(".png", cv::Mat(24, 30, CV_8UC1, cv::Scalar(1))));
  EXPECT_THAT(std::string(ReadLuminance(path, lens, {mask}).status().message()),
              AllOf(HasSubstr("m.png: found a mask of 30 x 24 pixels"), HasSubstr("36 x 24")));
}

TEST(PhotographTest, TheWhiteLevelScalesSixteenBits) {
  const std::string folder = FreshTestFolder("f");
  cv::Mat eight = RandomMat(CV_8UC3), twelve;
  eight.convertTo(twelve, CV_16U, 16);
  WriteText(folder + "/8.png", Encoded(".png", eight));
  WriteText(folder + "/12.png", Encoded(".png", twelve));
  WriteText(folder + "/12.tif", Encoded(".tif", twelve));
  const FloatImage expected = LuminanceAt(folder + "/8.png");
  for (const char* name : {"/12.png", "/12.tif"}) {
    const FloatImage image = LuminanceAt(folder + name, {"", 4095});
    for (size_t i = 0; i < image.data.size(); ++i) EXPECT_NEAR(image.data[i], expected.data[i], 0.004);
    EXPECT_NEAR(ReadRgb(folder + name, 4095)->at(4, 4, 1), eight.at<cv::Vec3b>(4, 4)[1], 1);
    EXPECT_GT(*HighestSample(folder + name), 3800);
    EXPECT_LT(*HighestSample(folder + name), 4096);
  }
  EXPECT_EQ(*HighestSample(folder + "/8.png"), 0);
  TiffFields fields;
  fields.bits = 16;
  fields.highest = 65535;
  WriteTiff(folder + "/tag.tif", fields);
  EXPECT_EQ(*HighestSample(folder + "/tag.tif"), 65535);
}

TEST(PhotographTest, IgnoresTheOrientationTag) {
  const std::string folder = FreshTestFolder("f");
  for (const int bits : {8, 16}) {
    for (const int orientation : {2, 3, 6, 8}) {
      TiffFields fields;
      fields.bits = bits;
      WriteTiff(folder + "/a.tif", fields);
      fields.orientation = orientation;
      WriteTiff(folder + "/b.tif", fields);
      EXPECT_EQ(ReadImageHeader(folder + "/a.tif")->orientation, 1);
      EXPECT_EQ(ReadImageHeader(folder + "/b.tif")->orientation, orientation);
      EXPECT_EQ(LuminanceAt(folder + "/b.tif").data, LuminanceAt(folder + "/a.tif").data);
    }
  }
  const std::string jpeg = Encoded(".jpg", RandomMat(CV_8UC3));
  const std::string exif("Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0", 32);
  WriteText(folder + "/a.jpg", jpeg);
  WriteText(folder + "/b.jpg", jpeg.substr(0, 2) + std::string("\xff\xe1\0\x22", 4) + exif + jpeg.substr(2));
  EXPECT_EQ(ReadImageHeader(folder + "/a.jpg")->orientation, 1);
  EXPECT_EQ(ReadImageHeader(folder + "/b.jpg")->orientation, 6);
  EXPECT_EQ(LuminanceAt(folder + "/b.jpg").data, LuminanceAt(folder + "/a.jpg").data);
}

TEST(PhotographTest, RefusalsSayWhatWasFound) {
  const std::string path = FreshTestFolder("f") + "/a.tif";
  const auto fault = [&](const TiffFields& fields) {
    WriteTiff(path, fields);
    return std::string(ReadLuminance(path, LensOfSize(kWide, kHigh)).status().message());
  };
  TiffFields fields;
  fields.bits = 32;
  fields.format = SAMPLEFORMAT_IEEEFP;
  testing::internal::CaptureStderr();
  testing::internal::CaptureStdout();
  EXPECT_THAT(fault(fields), AllOf(HasSubstr("a.tif: found 32-bit float samples"), HasSubstr("8- or 16-bit unsigned")));
  fields.bits = 16;
  fields.format = SAMPLEFORMAT_INT;
  EXPECT_THAT(fault(fields), HasSubstr("found 16-bit signed samples"));
  fields.format = SAMPLEFORMAT_UINT;
  fields.samples = 5;
  EXPECT_THAT(fault(fields), AllOf(HasSubstr("found 5 samples a pixel"), HasSubstr("red, green and blue")));
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
}

// Whatever bytes are damaged: no words of libraries on the terminal, and no pixels beyond the image.
TEST(PhotographTest, DamagedFilesPrintNothing) {
  const std::string folder = FreshTestFolder("f");
  TiffFields fields;
  WriteTiff(folder + "/whole.tif", fields);
  const std::vector<std::pair<std::string, std::string>> files = {
      {"/a.png", Encoded(".png", RandomMat(CV_8UC3))},
      {"/a.jpg", Encoded(".jpg", RandomMat(CV_8UC3))},
      {"/a.tif", ReadText(folder + "/whole.tif")}};
  testing::internal::CaptureStderr();
  testing::internal::CaptureStdout();
  int refused = 0;
  Random random(11);
  for (const auto& [name, whole] : files) {
    for (int i = 0; i < 60; ++i) {
      std::string bytes = whole;
      if (i % 3 == 0) bytes.resize(random.Below(bytes.size()));
      for (int k = 0; k < 1 + i % 4 && !bytes.empty(); ++k) {
        bytes[random.Below(bytes.size())] = static_cast<char>(random.Below(256));
      }
      WriteText(folder + name, bytes);
      refused += !ReadLuminance(folder + name, LensOfSize(kWide, kHigh)).ok();
      ReadRgb(folder + name).IgnoreError();
    }
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  EXPECT_GT(refused, 90);
  WriteText(folder + "/a.png", files[0].second.substr(0, files[0].second.size() / 2));
  EXPECT_THAT(std::string(ReadLuminance(folder + "/a.png", LensOfSize(kWide, kHigh)).status().message()),
              AllOf(HasSubstr("a.png: found a damaged PNG image (the file ends early)"), HasSubstr("export it again")));
}

}  // namespace
}  // namespace tessera
