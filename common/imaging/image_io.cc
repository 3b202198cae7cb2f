#include "common/imaging/image_io.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>

#include "absl/strings/str_cat.h"
#include "common/imaging/file_bytes.h"
#include "common/imaging/image_header.h"
#include "common/imaging/jpeg_file.h"
#include "common/imaging/png_file.h"
#include "common/imaging/tiff_file.h"
#include "common/imaging/undistort.h"

namespace tessera {
namespace {

using Bytes = std::vector<uint8_t>;

// Upper bound for all supported formats, except single-colour images in CCITT fax encoding.
constexpr int64_t kMaxPixelsPerByte = 2048;

// Decodes an image to 8 or 16 bits and 1 (grey), 3 (BGR) or 4 (BGRA) channels. Checks the header's size before
// decoding, because a small file may claim gigabytes: it must equal `expected`, or, without `expected`, be plausible
// for the length of the file.
StatusOr<cv::Mat> Decode(const std::string& path, const Bytes& bytes, const std::optional<ImageSize>& expected) {
  TESSERA_ASSIGN_OR_RETURN(const ImageHeader header, HeaderOf(path, bytes));
  const ImageSize size = header.size;
  if (IsJpeg(bytes) && !JpegEnds(bytes)) {
    return InputError(path, absl::StrCat("byte ", bytes.size()), "the end of the file", "the end of the JPEG image");
  }
  if (expected && size != *expected) {
    return InputError(path, "", absl::StrCat(size.width, " x ", size.height, " pixels"),
                      absl::StrCat(expected->width, " x ", expected->height, " (the size of its camera)"));
  }
  if (size.width <= 0 || size.height <= 0 ||
      size.width > static_cast<int64_t>(bytes.size()) * kMaxPixelsPerByte / size.height) {
    return InputError(path, "", absl::StrCat(size.width, " x ", size.height, " pixels in ", bytes.size(), " bytes"),
                      "a size that fits the length of the file");
  }
  cv::Mat image;
  try {
    if (IsPng(bytes)) {
      TESSERA_RETURN_IF_ERROR(DecodePng(path, bytes, &image));
    } else if (IsTiff(bytes)) {
      TESSERA_RETURN_IF_ERROR(DecodeTiffPhotograph(path, &image));
    } else {
      image.create(size.height, size.width, CV_8UC3);
      TESSERA_RETURN_IF_ERROR(DecodeJpeg(path, bytes, {image.data, image.step[0], size.width, size.height}));
    }
  } catch (const cv::Exception& error) {
    return InputError(path, "", error.err, "a JPEG, PNG or TIFF image");
  }
  if (image.cols != size.width || image.rows != size.height) {
    return InputError(path, "", "a damaged image", "a readable JPEG, PNG or TIFF image");
  }
  return image;
}

// An 8-bit image of 1, 3 (BGR) or 4 (BGRA) channels, as planes in the order red, green, blue, alpha.
ByteImage PlanesOf(const cv::Mat& mat) {
  const int channels = mat.channels();
  ByteImage image(mat.cols, mat.rows, channels);
  for (int y = 0; y < mat.rows; ++y) {
    const uint8_t* row = mat.ptr<uint8_t>(y);
    for (int x = 0; x < mat.cols; ++x) {
      for (int c = 0; c < channels; ++c) image.at(x, y, c) = row[channels * x + (channels > 1 && c < 3 ? 2 - c : c)];
    }
  }
  return image;
}

// Luminance of `width` pixels of blue, green and red.
template <class Value>
void FillLuminance(const Value* bgr, int width, float scale, float* __restrict out) {
  for (int x = 0; x < width; ++x) {
    const float b = bgr[3 * x], g = bgr[3 * x + 1], r = bgr[3 * x + 2];
    out[x] = scale * (0.299f * r + 0.587f * g + 0.114f * b);
  }
}

// Luminance of the pixels in `part`, or red, green and blue if `image` has three channels; NaN where alpha is 0.
template <class Value>
void FillPixels(const cv::Mat& mat, const ImagePart& part, int white_level, FloatImage* image) {
  const int channels = mat.channels(), green = channels > 1 ? 1 : 0, red = channels > 1 ? 2 : 0;
  const float scale = 1.0f / static_cast<float>(white_level);
  const bool colored = image->channels == 3;
  for (int y = part.y0; y < part.y1; ++y) {
    float* out = &image->at(0, y - part.y0) - part.x0;
    const Value* row = mat.ptr<Value>(y);
    if (channels == 3 && !colored) {
      FillLuminance(row + 3 * static_cast<ptrdiff_t>(part.x0), part.width(), scale, out + part.x0);
      continue;
    }
    for (int x = part.x0; x < part.x1; ++x) {
      const Value* pixel = row + static_cast<ptrdiff_t>(channels) * x;
      const float b = pixel[0], g = pixel[green], r = pixel[red];
      const bool is_transparent = channels == 4 && pixel[3] == 0;
      out[x] = is_transparent ? NAN : scale * (colored ? r : 0.299f * r + 0.587f * g + 0.114f * b);
      if (!colored) continue;
      out[x + image->plane_size()] = is_transparent ? NAN : scale * g;
      out[x + 2 * image->plane_size()] = is_transparent ? NAN : scale * b;
    }
  }
}

// Sets the masked pixels of `image`, which is `part` of a photograph of size `whole`, to NaN.
Status ApplyMask(const std::string& path, const ImageSize& whole, const ImagePart& part, FloatImage* image) {
  TESSERA_ASSIGN_OR_RETURN(const ByteImage mask, ReadMask(path, whole));
  const auto nearest = [](int64_t at, int size, int of) { return static_cast<int>((2 * at + 1) * of / (2 * size)); };
  for (int y = part.y0; y < part.y1; ++y) {
    const int v = nearest(y, whole.height, mask.height);
    for (int x = part.x0; x < part.x1; ++x) {
      if (mask.at(nearest(x, whole.width, mask.width), v) != 0) continue;
      for (int c = 0; c < image->channels; ++c) image->at(x - part.x0, y - part.y0, c) = NAN;
    }
  }
  return absl::OkStatus();
}

// `part` of the undistorted photograph: luminance (1 channel) or colours (3).
StatusOr<FloatImage> ReadPart(const std::string& path, const LensModel& lens, const ImagePart& part,
                              const PhotographOptions& options, int channels) {
  const PinholeCamera& whole = lens.pinhole;
  if (part.x0 < 0 || part.y0 < 0 || part.x1 > whole.width || part.y1 > whole.height || part.width() <= 0 ||
      part.height() <= 0) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": found columns ", part.x0, " to ", part.x1, ", rows ",
                                                   part.y0, " to ", part.y1, ", expected a part of its ", whole.width,
                                                   " x ", whole.height, " pixels"));
  }
  cv::Mat mat;
  {
    TESSERA_ASSIGN_OR_RETURN(const Bytes bytes, ReadFileBytes(path));
    TESSERA_ASSIGN_OR_RETURN(mat, Decode(path, bytes, ImageSize{whole.width, whole.height}));
  }
  const ImagePart source = SourcePart(lens, part);
  FloatImage image(source.width(), source.height(), channels);
  if (mat.depth() == CV_16U) {
    FillPixels<uint16_t>(mat, source, options.white_level > 0 ? options.white_level : 65535, &image);
  } else {
    FillPixels<uint8_t>(mat, source, 255, &image);
  }
  mat.release();
  if (!options.mask_path.empty()) {
    TESSERA_RETURN_IF_ERROR(ApplyMask(options.mask_path, {whole.width, whole.height}, source, &image));
  }
  return UndistortPart(std::move(image), source, lens, part, NAN);
}

}  // namespace

StatusOr<ImageSize> ReadImageSize(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const ImageHeader header, ReadImageHeader(path));
  return header.size;
}

StatusOr<FloatImage> ReadLuminancePart(const std::string& path, const LensModel& lens, const ImagePart& part,
                                       const PhotographOptions& options) {
  return ReadPart(path, lens, part, options, 1);
}

StatusOr<FloatImage> ReadLuminance(const std::string& path, const LensModel& lens, const PhotographOptions& options) {
  return ReadLuminancePart(path, lens, {0, 0, lens.pinhole.width, lens.pinhole.height}, options);
}

StatusOr<FloatImage> ReadColorPart(const std::string& path, const LensModel& lens, const ImagePart& part,
                                   const PhotographOptions& options) {
  return ReadPart(path, lens, part, options, 3);
}

StatusOr<ByteImage> ReadRgb(const std::string& path, int white_level) {
  TESSERA_ASSIGN_OR_RETURN(const Bytes bytes, ReadFileBytes(path));
  TESSERA_ASSIGN_OR_RETURN(const cv::Mat mat, Decode(path, bytes, std::nullopt));
  const bool wide = mat.depth() == CV_16U;
  const int channels = mat.channels();
  // As libpng and libtiff convert the full range: the high byte, or rounded.
  const bool rounded = IsTiff(bytes) && channels > 1;
  ByteImage image(mat.cols, mat.rows, 3);
  for (int y = 0; y < mat.rows; ++y) {
    for (int x = 0; x < mat.cols; ++x) {
      for (int c = 0; c < 3; ++c) {
        const int at = channels * x + (channels > 1 ? 2 - c : 0);
        int value = 0;
        if (!wide) {
          value = mat.ptr<uint8_t>(y)[at];
        } else if (const int sample = mat.ptr<uint16_t>(y)[at]; white_level > 0) {
          value = std::min(255, (255 * sample + white_level / 2) / white_level);
        } else {
          value = rounded ? (sample + 128) / 257 : sample >> 8;
        }
        image.at(x, y, c) = static_cast<uint8_t>(value);
      }
    }
  }
  return image;
}

StatusOr<ByteImage> ReadMask(const std::string& path, const ImageSize& photograph) {
  TESSERA_ASSIGN_OR_RETURN(const Bytes bytes, ReadFileBytes(path));
  TESSERA_ASSIGN_OR_RETURN(const cv::Mat mat, Decode(path, bytes, std::nullopt));
  const double height = static_cast<double>(mat.cols) * photograph.height / photograph.width;
  if (std::abs(mat.rows - height) > 1) {
    return InputError(
        path, "", absl::StrCat("a mask of ", mat.cols, " x ", mat.rows, " pixels"),
        absl::StrCat(photograph.width, " x ", photograph.height, " as its photograph, or the same aspect ratio"));
  }
  ByteImage mask(mat.cols, mat.rows);
  const int channels = mat.channels(), colours = std::min(channels, 3);
  for (int y = 0; y < mat.rows; ++y) {
    for (int x = 0; x < mat.cols; ++x) {
      bool black = true;
      for (int c = 0; c < colours; ++c) {
        black &= (mat.depth() == CV_16U ? mat.ptr<uint16_t>(y)[channels * x + c]
                                        : mat.ptr<uint8_t>(y)[channels * x + c]) == 0;
      }
      mask.at(x, y) = black ? 0 : 255;
    }
  }
  return mask;
}

StatusOr<int> HighestSample(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const ImageHeader header, ReadImageHeader(path));
  if (header.bits != 16) return 0;
  TESSERA_ASSIGN_OR_RETURN(const Bytes bytes, ReadFileBytes(path));
  int highest = 0;
  if (IsTiff(bytes)) {
    TESSERA_ASSIGN_OR_RETURN(const TiffPhotographHeader tiff, ReadTiffPhotographHeader(path));
    highest = tiff.highest_sample;
  }
  TESSERA_ASSIGN_OR_RETURN(const cv::Mat mat, Decode(path, bytes, std::nullopt));
  if (mat.depth() != CV_16U) return 0;
  const int channels = mat.channels(), colours = std::min(channels, 3);
  for (int y = 0; y < mat.rows; ++y) {
    const uint16_t* row = mat.ptr<uint16_t>(y);
    for (int x = 0; x < mat.cols; ++x) {
      for (int c = 0; c < colours; ++c) highest = std::max<int>(highest, row[channels * x + c]);
    }
  }
  return highest;
}

StatusOr<LabelImage> ReadLabelImage(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const Bytes bytes, ReadFileBytes(path));
  if (!IsPng(bytes)) return InputError(path, "byte 0", "no PNG signature", "a PNG image of class ids");
  TESSERA_ASSIGN_OR_RETURN(const cv::Mat mat, Decode(path, bytes, std::nullopt));
  if (mat.type() != CV_8UC1) {
    return InputError(path, "", absl::StrCat(mat.channels(), " channels of ", 8 * mat.elemSize1(), " bits"),
                      "one channel of 8 bits (class ids)");
  }
  return PlanesOf(mat);
}

StatusOr<PngPixels> DecodePngPixels(const std::string& path, const Bytes& bytes) {
  if (!IsPng(bytes)) return InputError(path, "byte 0", "no PNG signature", "a PNG image");
  TESSERA_ASSIGN_OR_RETURN(const cv::Mat mat, Decode(path, bytes, std::nullopt));
  const int channels = mat.channels();
  const bool wide = mat.depth() == CV_16U;
  if ((mat.depth() != CV_8U && !wide) || (channels != 1 && channels != 3 && channels != 4)) {
    return InputError(path, "", absl::StrCat(channels, " channels of ", 8 * mat.elemSize1(), " bits"),
                      "1, 3 or 4 channels of 8 or 16 bits");
  }
  PngPixels pixels = {channels > 1, Raster<uint32_t>(mat.cols, mat.rows)};
  for (int y = 0; y < mat.rows; ++y) {
    const uint8_t* row8 = mat.ptr<uint8_t>(y);
    const uint16_t* row16 = mat.ptr<uint16_t>(y);
    uint32_t* out = &pixels.values.at(0, y);
    for (int x = 0; x < mat.cols; ++x) {
      if (channels == 1) {
        out[x] = wide ? row16[x] : row8[x];
        continue;
      }
      const auto channel = [&](int c) {
        return static_cast<uint32_t>(wide ? row16[channels * x + c] >> 8 : row8[channels * x + c]);
      };
      out[x] = (channels == 4 ? channel(3) : 255) << 24 | channel(2) << 16 | channel(1) << 8 | channel(0);
    }
  }
  return pixels;
}

StatusOr<ByteImage> ReadPng(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const Bytes bytes, ReadFileBytes(path));
  if (!IsPng(bytes)) return InputError(path, "byte 0", "no PNG signature", "a PNG image");
  TESSERA_ASSIGN_OR_RETURN(const cv::Mat mat, Decode(path, bytes, std::nullopt));
  const int channels = mat.channels();
  if (mat.depth() != CV_8U || (channels != 1 && channels != 3 && channels != 4)) {
    return InputError(path, "", absl::StrCat(channels, " channels of ", 8 * mat.elemSize1(), " bits"),
                      "1, 3 or 4 channels of 8 bits");
  }
  return PlanesOf(mat);
}

Status WritePng(const std::string& path, const ByteImage& image) {
  TESSERA_ASSIGN_OR_RETURN(const Bytes bytes, EncodePng(image));
  return ReplaceFile(path, bytes);
}

Status WriteJpeg(const std::string& path, const ByteImage& image, int quality) {
  TESSERA_ASSIGN_OR_RETURN(const Bytes bytes, EncodeJpeg(image, quality));
  return ReplaceFile(path, bytes);
}

Status WriteLikelihoodTiff(const std::string& path, const ByteImage& pages) {
  TESSERA_ASSIGN_OR_RETURN(const Bytes bytes, EncodeTiffPages(pages));
  return ReplaceFile(path, bytes);
}

}  // namespace tessera
