#include "common/imaging/image_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
// libjpeg's header needs <cstdio>.
#include <jpeglib.h>

#include <limits>
#include <opencv2/imgcodecs.hpp>

#include "common/base/random.h"
#include "common/imaging/npy.h"
#include "common/imaging/undistort.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsNan;

LensModel PinholeOf(int width, int height) {
  LensModel lens;
  lens.pinhole = {width, height, 100, 100, width / 2.0, height / 2.0};
  return lens;
}

ByteImage RandomImage(int width, int height, int channels) {
  Random random(3);
  ByteImage image(width, height, channels);
  for (uint8_t& value : image.data) value = static_cast<uint8_t>(random.Below(256));
  return image;
}

std::string Npy(const std::string& header, const std::string& values) {
  std::string npy("\x93NUMPY\x01\x00", 8);
  npy += static_cast<char>(header.size() & 255);
  npy += static_cast<char>(header.size() >> 8);
  return npy + header + values;
}
std::vector<uint8_t> Bytes(const std::string& text) { return {text.begin(), text.end()}; }

StatusOr<FloatImage> ParseNpy(const std::vector<uint8_t>& bytes, const std::string& name) {
  TESSERA_ASSIGN_OR_RETURN(const NpyArray array, FindNpyArray(bytes, name));
  return NpyPart(array, {0, 0, array.width, array.height});
}

TEST(ImageIoTest, PngRoundTrip) {
  const std::string path = FreshTestFolder("f") + "/a.png";
  const ByteImage image = RandomImage(13, 7, 3);
  ASSERT_TRUE(WritePng(path, image).ok());
  EXPECT_EQ(*ReadImageSize(path), (ImageSize{13, 7}));
  EXPECT_EQ(ReadRgb(path)->data, image.data);
  const StatusOr<FloatImage> luminance = ReadLuminance(path, PinholeOf(13, 7));
  ASSERT_TRUE(luminance.ok()) << luminance.status();
  EXPECT_NEAR(luminance->at(4, 2),
              (0.299 * image.at(4, 2, 0) + 0.587 * image.at(4, 2, 1) + 0.114 * image.at(4, 2, 2)) / 255, 1e-6);
}

TEST(ImageIoTest, ReadsSizesOfJpegAndTiff) {
  const std::string folder = FreshTestFolder("f");
  ASSERT_TRUE(WriteJpeg(folder + "/a.jpg", RandomImage(33, 21, 3), 90).ok());
  EXPECT_EQ(*ReadImageSize(folder + "/a.jpg"), (ImageSize{33, 21}));
  ASSERT_TRUE(WriteLikelihoodTiff(folder + "/a.tif", RandomImage(33, 21, 2)).ok());
  EXPECT_EQ(*ReadImageSize(folder + "/a.tif"), (ImageSize{33, 21}));
}

TEST(ImageIoTest, RejectsDamagedImagesByName) {
  const std::string folder = FreshTestFolder("f");
  ASSERT_TRUE(WriteJpeg(folder + "/a.jpg", RandomImage(64, 64, 3), 90).ok());
  const std::string jpeg = ReadText(folder + "/a.jpg");
  WriteText(folder + "/a.jpg", jpeg.substr(0, jpeg.size() / 2));
  const Status cut = ReadLuminance(folder + "/a.jpg", PinholeOf(64, 64)).status();
  EXPECT_EQ(cut.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(cut.message()), HasSubstr("a.jpg"));
  ASSERT_TRUE(WritePng(folder + "/a.png", RandomImage(64, 64, 3)).ok());
  const std::string png = ReadText(folder + "/a.png");
  WriteText(folder + "/a.png", png.substr(0, png.size() / 2));
  EXPECT_FALSE(ReadLuminance(folder + "/a.png", PinholeOf(64, 64)).ok());
  WriteText(folder + "/empty.png", "");
  EXPECT_FALSE(ReadImageSize(folder + "/empty.png").ok());
  EXPECT_FALSE(ReadImageSize(folder + "/none.png").ok());
  EXPECT_FALSE(ReadLuminance(folder + "/empty.png", PinholeOf(64, 64)).ok());
}

TEST(ImageIoTest, JpegsHaveThePixelsOfOpenCv) {
  const std::string path = FreshTestFolder("f") + "/a.jpg";
  for (const int channels : {1, 3}) {
    for (const int quality : {40, 95}) {
      ASSERT_TRUE(WriteJpeg(path, RandomImage(61, 35, channels), quality).ok());
      const std::vector<uint8_t> bytes = Bytes(ReadText(path));
      const cv::Mat expected = cv::imdecode(bytes, cv::IMREAD_COLOR);
      const StatusOr<ByteImage> image = ReadRgb(path);
      ASSERT_TRUE(image.ok()) << image.status();
      ASSERT_EQ(image->width, expected.cols);
      ASSERT_EQ(image->height, expected.rows);
      for (int y = 0; y < image->height; ++y) {
        for (int x = 0; x < image->width; ++x) {
          for (int c = 0; c < 3; ++c) ASSERT_EQ(image->at(x, y, c), expected.at<cv::Vec3b>(y, x)[2 - c]);
        }
      }
    }
  }
}

TEST(ImageIoTest, FilesHaveTheBytesOfOpenCv) {
  const std::string folder = FreshTestFolder("f");
  for (const int channels : {1, 3}) {
    const ByteImage image = RandomImage(61, 35, channels);
    cv::Mat mat(image.height, image.width, CV_8UC(channels));
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) {
        for (int c = 0; c < channels; ++c) mat.ptr(y)[channels * x + c] = image.at(x, y, channels - 1 - c);
      }
    }
    std::vector<uint8_t> expected;
    ASSERT_TRUE(cv::imencode(".jpg", mat, expected, {cv::IMWRITE_JPEG_QUALITY, 85}));
    ASSERT_TRUE(WriteJpeg(folder + "/a.jpg", image, 85).ok());
    EXPECT_EQ(Bytes(ReadText(folder + "/a.jpg")), expected);
    ASSERT_TRUE(cv::imencode(".png", mat, expected));
    ASSERT_TRUE(WritePng(folder + "/a.png", image).ok());
    EXPECT_EQ(Bytes(ReadText(folder + "/a.png")), expected);
  }
}

// A JPEG of random CMYK pixels.
std::vector<uint8_t> CmykJpeg(int width, int height) {
  const ByteImage pixels = RandomImage(4 * width, height, 1);
  jpeg_compress_struct info = {};
  jpeg_error_mgr errors = {};
  info.err = jpeg_std_error(&errors);
  jpeg_create_compress(&info);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&info, &bytes, &size);
  info.image_width = width;
  info.image_height = height;
  info.input_components = 4;
  info.in_color_space = JCS_CMYK;
  jpeg_set_defaults(&info);
  jpeg_start_compress(&info, TRUE);
  for (int y = 0; y < height; ++y) {
    auto* row = const_cast<uint8_t*>(&pixels.at(0, y));
    jpeg_write_scanlines(&info, &row, 1);
  }
  jpeg_finish_compress(&info);
  jpeg_destroy_compress(&info);
  std::vector<uint8_t> result(bytes, bytes + size);
  std::free(bytes);
  return result;
}

TEST(ImageIoTest, CmykJpegsHaveThePixelsOfOpenCv) {
  const std::string path = FreshTestFolder("f") + "/a.jpg";
  const std::vector<uint8_t> bytes = CmykJpeg(61, 35);
  WriteText(path, {bytes.begin(), bytes.end()});
  const cv::Mat expected = cv::imdecode(bytes, cv::IMREAD_COLOR);
  const StatusOr<ByteImage> image = ReadRgb(path);
  ASSERT_TRUE(image.ok()) << image.status();
  for (int y = 0; y < image->height; ++y) {
    for (int x = 0; x < image->width; ++x) {
      for (int c = 0; c < 3; ++c) ASSERT_EQ(image->at(x, y, c), expected.at<cv::Vec3b>(y, x)[2 - c]);
    }
  }
}

// A JPEG of random pixels, and where its image data begins.
struct JpegText {
  std::string bytes;
  size_t data = 0;
};
JpegText WriteRandomJpeg(const std::string& path) {
  EXPECT_TRUE(WriteJpeg(path, RandomImage(160, 120, 3), 90).ok());
  JpegText jpeg = {ReadText(path)};
  const size_t scan = jpeg.bytes.find("\xff\xda");
  EXPECT_NE(scan, std::string::npos);
  jpeg.data = scan + 14;  // after the header of a scan of three components
  return jpeg;
}
std::string FaultOfImage(const std::string& path, const std::string& bytes) {
  WriteText(path, bytes);
  const Status luminance = ReadLuminance(path, PinholeOf(160, 120)).status(), rgb = ReadRgb(path).status();
  EXPECT_EQ(luminance, rgb);
  return std::string(luminance.message());
}

TEST(ImageIoTest, RefusesJpegsThatAreDamagedInside) {
  const std::string path = FreshTestFolder("f") + "/a.jpg";
  const JpegText jpeg = WriteRandomJpeg(path);
  const size_t middle = (jpeg.data + jpeg.bytes.size()) / 2;
  EXPECT_EQ(FaultOfImage(path, jpeg.bytes), "");
  // The second half is missing, but the file ends as it should: a decoder fills in grey.
  EXPECT_THAT(FaultOfImage(path, jpeg.bytes.substr(0, middle) + "\xff\xd9"),
              AllOf(HasSubstr("a.jpg: found a damaged JPEG image"), HasSubstr("at or before row "),
                    HasSubstr("premature end of data segment"), HasSubstr("copy or export it again")));
  std::string zeros = jpeg.bytes;
  std::fill_n(zeros.begin() + static_cast<std::ptrdiff_t>(middle), 1024, '\0');
  EXPECT_THAT(FaultOfImage(path, zeros), HasSubstr("a damaged JPEG image"));
  EXPECT_THAT(FaultOfImage(path, jpeg.bytes.substr(0, middle) + jpeg.bytes.substr(middle + 500)),
              HasSubstr("a damaged JPEG image"));
  // Image data that is left over.
  EXPECT_THAT(FaultOfImage(path, jpeg.bytes.substr(0, middle) + jpeg.bytes.substr(middle - 500)),
              HasSubstr("a damaged JPEG image"));
}

TEST(ImageIoTest, TakesJpegsWithPaddingAndTrailingData) {
  const std::string path = FreshTestFolder("f") + "/a.jpg";
  const JpegText jpeg = WriteRandomJpeg(path);
  const StatusOr<ByteImage> expected = ReadRgb(path);
  ASSERT_TRUE(expected.ok()) << expected.status();
  const std::string without_end = jpeg.bytes.substr(0, jpeg.bytes.size() - 2), end = "\xff\xd9";
  for (const std::string& bytes : {without_end + std::string(100, '\0') + end, jpeg.bytes + "a preview"}) {
    WriteText(path, bytes);
    const StatusOr<ByteImage> image = ReadRgb(path);
    ASSERT_TRUE(image.ok()) << image.status();
    EXPECT_EQ(image->data, expected->data);
  }
}

TEST(ImageIoTest, NamesLfsPointers) {
  const std::string path = FreshTestFolder("f") + "/a.jpg";
  WriteText(path, "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345678\n");
  EXPECT_THAT(std::string(ReadImageSize(path).status().message()),
              AllOf(HasSubstr("a.jpg: found a Git LFS pointer"), HasSubstr("git lfs pull")));
}

TEST(ImageIoTest, LuminanceRequiresTheCamerasSize) {
  const std::string path = FreshTestFolder("f") + "/a.png";
  ASSERT_TRUE(WritePng(path, RandomImage(13, 7, 1)).ok());
  EXPECT_THAT(std::string(ReadLuminance(path, PinholeOf(14, 7)).status().message()), HasSubstr("13 x 7 pixels"));
}

TEST(UndistortTest, MatchesAPinholeImage) {
  TinySceneOptions options;
  options.k1 = -0.15;
  options.k2 = 0.03;
  const std::string folder = FreshTestFolder("scene");
  const TinyScene scene = WriteTinyScene(folder, options);
  LensModel lens;
  lens.kind = LensModel::Kind::kOpenCv;
  lens.pinhole = scene.cameras[0].intrinsics;
  lens.coefficients[0] = options.k1;
  lens.coefficients[1] = options.k2;
  const auto median_error = [&](const LensModel& model) {
    const StatusOr<FloatImage> image = ReadLuminance(folder + "/images/" + scene.image_names[0], model);
    EXPECT_TRUE(image.ok()) << image.status();
    std::vector<double> errors;
    for (size_t i = 0; i < image->data.size(); ++i) {
      const double error = std::abs(image->data[i] - scene.pictures[0].data[i]);
      if (std::isfinite(error)) errors.push_back(error);
    }
    std::nth_element(errors.begin(), errors.begin() + errors.size() / 2, errors.end());
    return errors[errors.size() / 2];
  };
  EXPECT_LT(median_error(lens), 0.004);
  LensModel ignored = lens;
  ignored.kind = LensModel::Kind::kPinhole;
  EXPECT_GT(median_error(ignored), 2 * median_error(lens));  // the lens does matter
}

TEST(UndistortTest, PixelsOutsideThePhotographAreMarked) {
  LensModel lens = PinholeOf(100, 80);
  lens.kind = LensModel::Kind::kRadial;
  const ImagePart whole = {0, 0, 100, 80};
  lens.coefficients[0] = 0.5;  // pincushion: corners are looked for beyond the photograph
  const FloatImage image = UndistortPart(FloatImage(100, 80, 1, 0.5f), whole, lens, whole, NAN);
  EXPECT_TRUE(std::isnan(image.at(0, 0)));
  EXPECT_FLOAT_EQ(image.at(50, 40), 0.5f);
  lens.coefficients[0] = -2;  // folds back within the image
  lens.coefficients[1] = 0;
  const FloatImage folded = UndistortPart(FloatImage(100, 80, 1, 0.5f), whole, lens, whole, NAN);
  EXPECT_TRUE(std::isnan(folded.at(0, 0)));
  EXPECT_FLOAT_EQ(folded.at(50, 40), 0.5f);
}

TEST(LikelihoodTest, TiffIsNormalised) {
  const std::string path = FreshTestFolder("f") + "/a.tif";
  ByteImage pages(4, 3, 3, 0);
  pages.at(1, 2, 0) = 30;
  pages.at(1, 2, 2) = 90;
  ASSERT_TRUE(WriteLikelihoodTiff(path, pages).ok());
  const StatusOr<FloatImage> image = ReadLikelihoods(path, 3, PinholeOf(4, 3));
  ASSERT_TRUE(image.ok()) << image.status();
  EXPECT_FLOAT_EQ(image->at(1, 2, 0), 0.25f);
  EXPECT_FLOAT_EQ(image->at(1, 2, 1), 0);
  EXPECT_FLOAT_EQ(image->at(1, 2, 2), 0.75f);
  EXPECT_FLOAT_EQ(image->at(0, 0, 1), 1.0f / 3);  // all zero: uniform
}

TEST(LikelihoodTest, WrongPageCountAndAspectRatio) {
  const std::string path = FreshTestFolder("f") + "/a.tif";
  ASSERT_TRUE(WriteLikelihoodTiff(path, RandomImage(40, 30, 3)).ok());
  EXPECT_THAT(std::string(ReadLikelihoods(path, 4, PinholeOf(40, 30)).status().message()),
              HasSubstr("a.tif: found 3 pages, expected 4"));
  EXPECT_TRUE(ReadLikelihoods(path, 3, PinholeOf(160, 120)).ok());  // a quarter of the photograph's size
  EXPECT_FALSE(ReadLikelihoods(path, 3, PinholeOf(160, 160)).ok());
  EXPECT_TRUE(ReadLikelihoods(path, 3, PinholeOf(20, 15)).ok());  // the photograph was reduced
  EXPECT_FALSE(ReadLikelihoods(path, 3, PinholeOf(8, 6)).ok());   // to less than a quarter
}

TEST(LikelihoodTest, RejectsTruncatedTiff) {
  const std::string path = FreshTestFolder("f") + "/a.tif";
  ASSERT_TRUE(WriteLikelihoodTiff(path, RandomImage(40, 30, 3)).ok());
  const std::string whole = ReadText(path);
  for (const double share : {0.1, 0.5, 0.9}) {
    WriteText(path, whole.substr(0, static_cast<size_t>(share * static_cast<double>(whole.size()))));
    EXPECT_FALSE(ReadLikelihoods(path, 3, PinholeOf(40, 30)).ok());
  }
}

TEST(LikelihoodTest, LabelPng) {
  const std::string path = FreshTestFolder("f") + "/a.png";
  ByteImage labels(4, 3, 1, 255);
  labels.at(2, 1) = 1;
  ASSERT_TRUE(WritePng(path, labels).ok());
  const StatusOr<FloatImage> image = ReadLikelihoods(path, 3, PinholeOf(4, 3));
  ASSERT_TRUE(image.ok()) << image.status();
  EXPECT_FLOAT_EQ(image->at(2, 1, 1), 0.8f);
  EXPECT_FLOAT_EQ(image->at(2, 1, 0), 0.1f);
  EXPECT_FLOAT_EQ(image->at(0, 0, 0), 1.0f / 3);
  labels.at(3, 2) = 3;
  ASSERT_TRUE(WritePng(path, labels).ok());
  EXPECT_THAT(std::string(ReadLikelihoods(path, 3, PinholeOf(4, 3)).status().message()),
              HasSubstr("pixel (3, 2): found label 3"));
}

TEST(LikelihoodTest, NanAndNegativeNpyValuesNameThePixel) {
  const std::string path = FreshTestFolder("f") + "/a.npy";
  float values[2 * 3 * 4] = {};
  values[12 + 4 + 2] = NAN;
  const std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3, 4), }\n";
  const auto write = [&] { WriteText(path, Npy(header, {reinterpret_cast<char*>(values), sizeof values})); };
  write();
  EXPECT_THAT(std::string(ReadLikelihoods(path, 2, PinholeOf(4, 3)).status().message()),
              HasSubstr("class 1, pixel (2, 1): found NaN"));
  values[12 + 4 + 2] = -1;
  write();
  EXPECT_THAT(std::string(ReadLikelihoods(path, 2, PinholeOf(4, 3)).status().message()), HasSubstr("found -1"));
  values[12 + 4 + 2] = 1;
  write();
  const StatusOr<FloatImage> image = ReadLikelihoods(path, 2, PinholeOf(4, 3));
  ASSERT_TRUE(image.ok()) << image.status();
  EXPECT_EQ(image->at(2, 1, 1), 1);
  EXPECT_THAT(std::string(ReadLikelihoods(path, 3, PinholeOf(4, 3)).status().message()), HasSubstr("found 2 classes"));
}

TEST(NpyTest, ReadsHalfAndByte) {
  const auto half = ParseNpy(Bytes(Npy("{'descr': '<f2', 'fortran_order': False, 'shape': (1, 1, 6), }",
                                       std::string("\x00\x3c\x00\xc0\x55\x35\x01\x00\x00\x7c\x00\x7e", 12))),
                             "a");
  ASSERT_TRUE(half.ok()) << half.status();
  EXPECT_THAT(half->data, ElementsAre(1, -2, 0.333251953125f, std::ldexp(1.0f, -24),
                                      std::numeric_limits<float>::infinity(), IsNan()));
  const auto byte =
      ParseNpy(Bytes(Npy("{'shape': (2, 1, 1), 'fortran_order': False, 'descr': '|u1'}", "\x07\x09")), "a");
  ASSERT_TRUE(byte.ok()) << byte.status();
  EXPECT_EQ(byte->data, (std::vector<float>{7, 9}));
}

TEST(NpyTest, RejectsMalformedFiles) {
  const char* headers[] = {
      "{'descr': '<c8', 'fortran_order': False, 'shape': (1, 1, 1)}",
      "{'descr': '<f1', 'fortran_order': False, 'shape': (1, 1, 1)}",
      "{'descr': '', 'fortran_order': False, 'shape': (1, 1, 1)}",
      "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 1, 1)}",
      "{'descr': '<f4', 'fortran_order': False, 'shape': (1,)}",
      "{'descr': '<u1', 'fortran_order': False, 'shape': (2, 1, 1, 2)}",
      "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 2)}",
      "{'descr': '<f4', 'fortran_order': False, 'shape': (0, 1, 1)}",
      "{'descr': '<f4', 'fortran_order': False, 'shape': (999999999999, 999999999999, 999999999999)}",
      "{'descr': '<f4', 'fortran_order': False}",
      "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 1), 'extra': 1}",
      "",
  };
  for (const char* header : headers) {
    const Status status = ParseNpy(Bytes(Npy(header, "\x01\x02\x03\x04")), "a.npy").status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << header;
    EXPECT_THAT(std::string(status.message()), HasSubstr("a.npy"));
  }
  EXPECT_TRUE(
      ParseNpy(Bytes(Npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 1)}", "\x01\x02\x03\x04")), "a.npy")
          .ok());
  std::string long_header("\x93NUMPY\x02\x00\xff\xff\xff\xff", 12);
  EXPECT_FALSE(ParseNpy(Bytes(long_header), "a.npy").ok());
}

TEST(NpyTest, RejectsEveryPrefixOfAFile) {
  const std::string whole = Npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 1)}", "\x01\x02\x03\x04");
  for (size_t n = 0; n < whole.size(); ++n) EXPECT_FALSE(ParseNpy(Bytes(whole.substr(0, n)), "a").ok()) << n;
}

}  // namespace
}  // namespace tessera
