#include "common/imaging/image_io.h"

#include <cmath>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <optional>

#include "absl/strings/str_cat.h"
#include "common/imaging/file_bytes.h"
#include "common/imaging/jpeg_file.h"
#include "common/imaging/tiff_file.h"
#include "common/imaging/undistort.h"
#include "common/storage/lfs_pointer.h"

namespace tessera {
namespace {

using Bytes = std::vector<uint8_t>;

bool StartsWith(const Bytes& bytes, const char* magic, size_t size) {
  return bytes.size() >= size && std::memcmp(bytes.data(), magic, size) == 0;
}
bool IsPng(const Bytes& bytes) { return StartsWith(bytes, "\x89PNG\r\n\x1a\n", 8); }
bool IsJpeg(const Bytes& bytes) { return StartsWith(bytes, "\xff\xd8\xff", 3); }
bool IsTiff(const Bytes& bytes) {
  return StartsWith(bytes, "II*\0", 4) || StartsWith(bytes, "MM\0*", 4) || StartsWith(bytes, "II+\0", 4) ||
         StartsWith(bytes, "MM\0+", 4);
}

uint32_t BigEndian(const Bytes& bytes, size_t at, int count) {
  uint32_t value = 0;
  for (int i = 0; i < count; ++i) value = value << 8 | bytes[at + i];
  return value;
}

struct JpegLayout {
  ImageSize size;
  size_t scan_offset = 0;  // of the first start-of-scan marker; 0 if there is none
};

// Walks the marker segments up to the first scan (ITU T.81, annex B).
JpegLayout WalkJpeg(const Bytes& bytes) {
  JpegLayout layout;
  size_t at = 2;
  while (at + 4 <= bytes.size() && bytes[at] == 0xff) {
    const uint8_t marker = bytes[at + 1];
    if (marker == 0xff) {  // fill byte
      ++at;
      continue;
    }
    if (marker == 0xda) {
      layout.scan_offset = at;
      break;
    }
    const bool is_frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (is_frame && at + 9 <= bytes.size()) {
      layout.size = {static_cast<int>(BigEndian(bytes, at + 7, 2)), static_cast<int>(BigEndian(bytes, at + 5, 2))};
    }
    at += 2 + BigEndian(bytes, at + 2, 2);
  }
  return layout;
}

// Whether the image data ends with an end-of-image marker. Decoders fill the missing part of a truncated JPEG with grey
// without an error.
bool JpegEnds(const Bytes& bytes) {
  const size_t scan = WalkJpeg(bytes).scan_offset;
  if (scan == 0) return false;
  for (size_t i = bytes.size() - 1; i > scan; --i) {
    if (bytes[i] == 0xd9 && bytes[i - 1] == 0xff) return true;
  }
  return false;
}

// Upper bound for all supported formats, except single-colour images in CCITT fax encoding.
constexpr int64_t kMaxPixelsPerByte = 2048;

// The size in the image's header. `bytes`: the file at `path` or its beginning. 0 x 0 if a JPEG's frame header lies
// beyond `bytes`.
StatusOr<ImageSize> HeaderSize(const std::string& path, const Bytes& bytes) {
  if (IsTiff(bytes)) {
    TESSERA_ASSIGN_OR_RETURN(const TiffSize size, ReadTiffSize(path));
    return ImageSize{size.width, size.height};
  }
  if (IsJpeg(bytes)) return WalkJpeg(bytes).size;
  if (IsLfsPointer({reinterpret_cast<const char*>(bytes.data()), bytes.size()})) return LfsPointerError(path);
  if (!IsPng(bytes)) {
    return InputError(path, "byte 0", bytes.empty() ? "an empty file" : "an unknown format",
                      "a JPEG, PNG or TIFF image");
  }
  if (bytes.size() < 24) {
    return InputError(path, absl::StrCat("byte ", bytes.size()), "the end of the file", "a whole PNG header");
  }
  return ImageSize{static_cast<int>(BigEndian(bytes, 16, 4)), static_cast<int>(BigEndian(bytes, 20, 4))};
}

// Decodes an image. Checks the header's size before decoding, because a small file may claim gigabytes: it must equal
// `expected`, or, without `expected`, be plausible for the length of the file. `flags`: of OpenCV; a JPEG is decoded to
// three channels of 8 bits whatever they say.
StatusOr<cv::Mat> Decode(const std::string& path, const Bytes& bytes, const std::optional<ImageSize>& expected,
                         int flags) {
  TESSERA_ASSIGN_OR_RETURN(const ImageSize size, HeaderSize(path, bytes));
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
    if (IsJpeg(bytes)) {
      image.create(size.height, size.width, CV_8UC3);
      TESSERA_ASSIGN_OR_RETURN(const bool decoded,
                               DecodeJpeg(path, bytes, {image.data, image.step[0], size.width, size.height}));
      if (decoded) return image;
    }
    image = cv::imdecode(bytes, flags | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception& error) {
    return InputError(path, "", error.err, "a JPEG, PNG or TIFF image");
  }
  if (image.empty()) return InputError(path, "", "a damaged image", "a readable JPEG, PNG or TIFF image");
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

Status EncodeAndReplace(const std::string& path, const ByteImage& image, const std::string& extension,
                        const std::vector<int>& parameters) {
  if (image.empty() || (image.channels != 1 && image.channels != 3)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": cannot write an image of ", image.width, " x ",
                                                   image.height, " pixels and ", image.channels, " channels"));
  }
  cv::Mat mat(image.height, image.width, CV_8UC(image.channels));
  for (int y = 0; y < image.height; ++y) {
    uint8_t* row = mat.ptr<uint8_t>(y);
    for (int x = 0; x < image.width; ++x) {
      for (int c = 0; c < image.channels; ++c) row[image.channels * x + c] = image.at(x, y, image.channels - 1 - c);
    }
  }
  Bytes bytes;
  try {
    if (!cv::imencode(extension, mat, bytes, parameters)) return absl::InternalError(path + ": cannot encode");
  } catch (const cv::Exception& error) {
    return absl::InternalError(absl::StrCat(path, ": cannot encode: ", error.err));
  }
  return ReplaceFile(path, bytes);
}

}  // namespace

StatusOr<ImageSize> ReadImageSize(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(Bytes bytes, ReadFileStart(path, 64 * 1024));
  TESSERA_ASSIGN_OR_RETURN(ImageSize size, HeaderSize(path, bytes));
  if (IsJpeg(bytes) && size.width == 0) {  // long metadata before the frame header
    TESSERA_ASSIGN_OR_RETURN(bytes, ReadFileBytes(path));
    size = WalkJpeg(bytes).size;
  }
  if (size.width <= 0 || size.height <= 0) {
    return InputError(path, "", "no image size in the header", "a JPEG, PNG or TIFF image");
  }
  return size;
}

StatusOr<FloatImage> ReadLuminancePart(const std::string& path, const LensModel& lens, const ImagePart& part) {
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
    TESSERA_ASSIGN_OR_RETURN(
        mat, Decode(path, bytes, ImageSize{whole.width, whole.height}, cv::IMREAD_COLOR | cv::IMREAD_ANYDEPTH));
  }
  if (mat.cols != whole.width || mat.rows != whole.height) {
    return InputError(path, "", absl::StrCat(mat.cols, " x ", mat.rows, " pixels"),
                      absl::StrCat(whole.width, " x ", whole.height, " (the size of its camera)"));
  }
  if (mat.depth() != CV_8U && mat.depth() != CV_16U) {
    return InputError(path, "", "an unsupported sample format", "8- or 16-bit unsigned samples");
  }
  const ImagePart source = SourcePart(lens, part);
  FloatImage image(source.width(), source.height());
  const bool wide = mat.depth() == CV_16U;
  const float scale = wide ? 1.0f / 65535 : 1.0f / 255;
  for (int y = source.y0; y < source.y1; ++y) {
    float* out = &image.at(0, y - source.y0) - source.x0;
    const uint8_t* row8 = mat.ptr<uint8_t>(y);
    const uint16_t* row16 = mat.ptr<uint16_t>(y);
    for (int x = source.x0; x < source.x1; ++x) {
      const float b = wide ? row16[3 * x] : row8[3 * x], g = wide ? row16[3 * x + 1] : row8[3 * x + 1];
      const float r = wide ? row16[3 * x + 2] : row8[3 * x + 2];
      out[x] = scale * (0.299f * r + 0.587f * g + 0.114f * b);
    }
  }
  mat.release();
  return UndistortPart(std::move(image), source, lens, part, NAN);
}

StatusOr<FloatImage> ReadLuminance(const std::string& path, const LensModel& lens) {
  return ReadLuminancePart(path, lens, {0, 0, lens.pinhole.width, lens.pinhole.height});
}

StatusOr<ByteImage> ReadRgb(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const Bytes bytes, ReadFileBytes(path));
  TESSERA_ASSIGN_OR_RETURN(const cv::Mat mat, Decode(path, bytes, std::nullopt, cv::IMREAD_COLOR));
  return PlanesOf(mat);
}

StatusOr<LabelImage> ReadLabelImage(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const Bytes bytes, ReadFileBytes(path));
  if (!IsPng(bytes)) return InputError(path, "byte 0", "no PNG signature", "a PNG image of class ids");
  TESSERA_ASSIGN_OR_RETURN(const cv::Mat mat, Decode(path, bytes, std::nullopt, cv::IMREAD_UNCHANGED));
  if (mat.type() != CV_8UC1) {
    return InputError(path, "", absl::StrCat(mat.channels(), " channels of ", 8 * mat.elemSize1(), " bits"),
                      "one channel of 8 bits (class ids)");
  }
  return PlanesOf(mat);
}

StatusOr<PngPixels> DecodePng(const std::string& path, const Bytes& bytes) {
  if (!IsPng(bytes)) return InputError(path, "byte 0", "no PNG signature", "a PNG image");
  TESSERA_ASSIGN_OR_RETURN(const cv::Mat mat, Decode(path, bytes, std::nullopt, cv::IMREAD_UNCHANGED));
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
  TESSERA_ASSIGN_OR_RETURN(const cv::Mat mat, Decode(path, bytes, std::nullopt, cv::IMREAD_UNCHANGED));
  const int channels = mat.channels();
  if (mat.depth() != CV_8U || (channels != 1 && channels != 3 && channels != 4)) {
    return InputError(path, "", absl::StrCat(channels, " channels of ", 8 * mat.elemSize1(), " bits"),
                      "1, 3 or 4 channels of 8 bits");
  }
  return PlanesOf(mat);
}

Status WritePng(const std::string& path, const ByteImage& image) { return EncodeAndReplace(path, image, ".png", {}); }

Status WriteJpeg(const std::string& path, const ByteImage& image, int quality) {
  return EncodeAndReplace(path, image, ".jpg", {cv::IMWRITE_JPEG_QUALITY, quality});
}

Status WriteLikelihoodTiff(const std::string& path, const ByteImage& pages) {
  TESSERA_ASSIGN_OR_RETURN(const Bytes bytes, EncodeTiffPages(pages));
  return ReplaceFile(path, bytes);
}

}  // namespace tessera
