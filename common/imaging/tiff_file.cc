#include "common/imaging/tiff_file.h"

#include <stdlib.h>
#include <tiffio.h>

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <memory>
#include <opencv2/core.hpp>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

struct TiffCloser {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};
using TiffPtr = std::unique_ptr<TIFF, TiffCloser>;

// Error handler for libtiff: stores the first message of a file in the std::string at `user`.
int KeepFirstError(TIFF*, void* user, const char*, const char* format, va_list arguments) {
  std::string& message = *static_cast<std::string*>(user);
  if (message.empty()) {
    char text[256];
    std::vsnprintf(text, sizeof text, format, arguments);
    message = text;
  }
  return 1;
}

int IgnoreWarning(TIFF*, void*, const char*, const char*, va_list) { return 1; }

TiffPtr OpenTiff(const std::string& path, std::string* error) {
  TIFFOpenOptions* options = TIFFOpenOptionsAlloc();
  TIFFOpenOptionsSetErrorHandlerExtR(options, KeepFirstError, error);
  TIFFOpenOptionsSetWarningHandlerExtR(options, IgnoreWarning, nullptr);
  TiffPtr tiff(TIFFOpenExt(path.c_str(), "rm", options));
  TIFFOpenOptionsFree(options);
  return tiff;
}

TiffSize CurrentSize(TIFF* tiff) {
  uint32_t width = 0, height = 0;
  TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &width);
  TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &height);
  return {static_cast<int>(std::min<uint32_t>(width, INT32_MAX)),
          static_cast<int>(std::min<uint32_t>(height, INT32_MAX)), 0};
}

struct SampleLayout {
  int bytes = 1;
  bool is_float = false;
};

// Converts `count` samples. One loop per type, so that each is vectorised.
void ConvertSamples(const uint8_t* from, int count, SampleLayout layout, float* __restrict to) {
  if (layout.is_float) {
    std::memcpy(to, from, sizeof(float) * count);
  } else if (layout.bytes == 1) {
    for (int i = 0; i < count; ++i) to[i] = from[i];
  } else {
    for (int i = 0; i < count; ++i) {
      uint16_t value;
      std::memcpy(&value, from + 2 * i, 2);
      to[i] = value;
    }
  }
}

Status ReadTiles(TIFF* tiff, const std::string& path, const std::string& location, SampleLayout layout,
                 const ImagePart& part, const std::string& error, float* plane) {
  uint32_t tile_width = 0, tile_height = 0;
  TIFFGetField(tiff, TIFFTAG_TILEWIDTH, &tile_width);
  TIFFGetField(tiff, TIFFTAG_TILELENGTH, &tile_height);
  if (tile_width == 0 || tile_height == 0 || tile_width > 4096 || tile_height > 4096) {
    return InputError(path, location, absl::StrCat("tiles of ", tile_width, " x ", tile_height, " pixels"),
                      "1 x 1 to 4096 x 4096");
  }
  const size_t tile_bytes = size_t{tile_width} * tile_height * layout.bytes;
  if (TIFFTileSize(tiff) != static_cast<tmsize_t>(tile_bytes)) {
    return InputError(path, location, absl::StrCat("tiles of ", TIFFTileSize(tiff), " bytes"),
                      absl::StrCat(tile_bytes));
  }
  std::vector<uint8_t> tile(tile_bytes);
  const int step_x = static_cast<int>(tile_width), step_y = static_cast<int>(tile_height);
  for (int y0 = part.y0 / step_y * step_y; y0 < part.y1; y0 += step_y) {
    for (int x0 = part.x0 / step_x * step_x; x0 < part.x1; x0 += step_x) {
      if (TIFFReadTile(tiff, tile.data(), x0, y0, 0, 0) < 0) {
        return InputError(path, absl::StrCat(location, ", tile at ", x0, ", ", y0), error, "readable pixels");
      }
      for (int y = std::max(y0, part.y0); y < std::min(part.y1, y0 + step_y); ++y) {
        const int x = std::max(x0, part.x0);
        const size_t index = size_t(y - y0) * tile_width + (x - x0);
        ConvertSamples(tile.data() + index * layout.bytes, std::min(part.x1, x0 + step_x) - x, layout,
                       plane + size_t(y - part.y0) * part.width() + (x - part.x0));
      }
    }
  }
  return absl::OkStatus();
}

Status ReadPage(TIFF* tiff, const std::string& path, int page, const TiffSize& expected, const ImagePart& part,
                const std::string& error, float* plane) {
  const std::string location = absl::StrCat("page ", page);
  const TiffSize size = CurrentSize(tiff);
  if (size.width != expected.width || size.height != expected.height) {
    return InputError(path, location, absl::StrCat(size.width, " x ", size.height, " pixels"),
                      absl::StrCat(expected.width, " x ", expected.height));
  }
  uint16_t samples = 1, bits = 1, format = SAMPLEFORMAT_UINT;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &samples);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &bits);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLEFORMAT, &format);
  if (samples != 1)
    return InputError(path, location, absl::StrCat(samples, " samples per pixel"), "1 (one page per class)");
  const bool is_float = format == SAMPLEFORMAT_IEEEFP && bits == 32;
  if (!is_float && !(format == SAMPLEFORMAT_UINT && (bits == 8 || bits == 16))) {
    return InputError(path, location, absl::StrCat(bits, "-bit samples of format ", format),
                      "8- or 16-bit unsigned or 32-bit float");
  }
  const SampleLayout layout{bits / 8, is_float};
  if (TIFFIsTiled(tiff)) return ReadTiles(tiff, path, location, layout, part, error, plane);
  const tmsize_t row_bytes = static_cast<tmsize_t>(size.width) * layout.bytes;
  if (TIFFScanlineSize(tiff) != row_bytes) {
    return InputError(path, location, absl::StrCat("rows of ", TIFFScanlineSize(tiff), " bytes"),
                      absl::StrCat(row_bytes));
  }
  std::vector<uint8_t> row(row_bytes);
  // libtiff reads the rows of a strip only in order, so start at the strip's first row.
  uint32_t strip_rows = 0;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_ROWSPERSTRIP, &strip_rows);
  const int step = static_cast<int>(std::clamp<uint32_t>(strip_rows, 1, static_cast<uint32_t>(size.height)));
  for (int y = part.y0 / step * step; y < part.y1; ++y) {
    if (TIFFReadScanline(tiff, row.data(), y) < 0) {
      return InputError(path, absl::StrCat(location, ", row ", y), error.empty() ? "unreadable pixels" : error,
                        "readable pixels");
    }
    if (y < part.y0) continue;
    ConvertSamples(row.data() + size_t(part.x0) * layout.bytes, part.width(), layout,
                   plane + size_t(y - part.y0) * part.width());
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<TiffSize> ReadTiffSize(const std::string& path) {
  std::string error;
  const TiffPtr tiff = OpenTiff(path, &error);
  if (!tiff) return InputError(path, "", error, "a TIFF file");
  TiffSize size = CurrentSize(tiff.get());
  size.pages = static_cast<int>(TIFFNumberOfDirectories(tiff.get()));
  if (size.width <= 0 || size.height <= 0) return InputError(path, "page 1", "no image size", "an image");
  if (size.pages <= 0) return InputError(path, "page 1", "the end of the file", "a whole page");
  return size;
}

StatusOr<FloatImage> ReadTiffPages(const std::string& path, const TiffSize& expected) {
  return ReadTiffPages(path, expected, {0, 0, expected.width, expected.height});
}

StatusOr<FloatImage> ReadTiffPages(const std::string& path, const TiffSize& expected, const ImagePart& part) {
  std::string error;
  const TiffPtr tiff = OpenTiff(path, &error);
  if (!tiff) return InputError(path, "", error, "a TIFF file");
  const int pages = static_cast<int>(TIFFNumberOfDirectories(tiff.get()));
  if (pages != expected.pages) {
    return InputError(path, "", absl::StrCat(pages, " pages"), absl::StrCat(expected.pages));
  }
  FloatImage image(part.width(), part.height(), expected.pages);
  for (int page = 0; page < pages; ++page) {
    error.clear();
    if (!TIFFSetDirectory(tiff.get(), static_cast<tdir_t>(page))) {
      return InputError(path, absl::StrCat("page ", page + 1), error, "a readable page");
    }
    TESSERA_RETURN_IF_ERROR(ReadPage(tiff.get(), path, page + 1, expected, part, error, image.plane(page)));
  }
  return image;
}

namespace {

// Callbacks for libtiff that write into memory.
struct Memory {
  std::vector<uint8_t> bytes;
  size_t position = 0;

  static tmsize_t Read(thandle_t handle, void* out, tmsize_t count) {
    Memory& m = *static_cast<Memory*>(handle);
    const size_t n = m.position < m.bytes.size() ? std::min<size_t>(count, m.bytes.size() - m.position) : 0;
    if (n > 0) std::memcpy(out, m.bytes.data() + m.position, n);
    m.position += n;
    return static_cast<tmsize_t>(n);
  }
  static tmsize_t Write(thandle_t handle, void* in, tmsize_t count) {
    Memory& m = *static_cast<Memory*>(handle);
    if (m.position + count > m.bytes.size()) m.bytes.resize(m.position + count);
    std::memcpy(m.bytes.data() + m.position, in, count);
    m.position += count;
    return count;
  }
  static toff_t Seek(thandle_t handle, toff_t offset, int whence) {
    Memory& m = *static_cast<Memory*>(handle);
    m.position = offset + (whence == SEEK_CUR ? m.position : whence == SEEK_END ? m.bytes.size() : 0);
    return m.position;
  }
  static int Close(thandle_t) { return 0; }
  static toff_t Size(thandle_t handle) { return static_cast<Memory*>(handle)->bytes.size(); }
};

}  // namespace

StatusOr<std::vector<uint8_t>> EncodeTiffPages(const ByteImage& pages) {
  if (pages.empty()) return absl::InvalidArgumentError("cannot write a TIFF without pixels or pages");
  Memory memory;
  {
    const TiffPtr tiff(TIFFClientOpen("memory", "w", &memory, Memory::Read, Memory::Write, Memory::Seek, Memory::Close,
                                      Memory::Size, nullptr, nullptr));
    if (!tiff) return absl::InternalError("libtiff cannot write to memory");
    for (int page = 0; page < pages.channels; ++page) {
      TIFFSetField(tiff.get(), TIFFTAG_IMAGEWIDTH, static_cast<uint32_t>(pages.width));
      TIFFSetField(tiff.get(), TIFFTAG_IMAGELENGTH, static_cast<uint32_t>(pages.height));
      TIFFSetField(tiff.get(), TIFFTAG_BITSPERSAMPLE, 8);
      TIFFSetField(tiff.get(), TIFFTAG_SAMPLESPERPIXEL, 1);
      TIFFSetField(tiff.get(), TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
      TIFFSetField(tiff.get(), TIFFTAG_COMPRESSION, COMPRESSION_LZW);
      TIFFSetField(tiff.get(), TIFFTAG_ROWSPERSTRIP, TIFFDefaultStripSize(tiff.get(), 0));
      TIFFSetField(tiff.get(), TIFFTAG_SUBFILETYPE, FILETYPE_PAGE);
      TIFFSetField(tiff.get(), TIFFTAG_PAGENUMBER, page, pages.channels);
      for (int y = 0; y < pages.height; ++y) {
        // The const_cast is safe: libtiff changes the row only if it must swap bytes.
        auto* row = const_cast<uint8_t*>(pages.plane(page) + size_t(y) * pages.width);
        if (TIFFWriteScanline(tiff.get(), row, y) < 0) return absl::InternalError("libtiff cannot write a row");
      }
      if (!TIFFWriteDirectory(tiff.get())) return absl::InternalError("libtiff cannot write a page");
    }
  }
  return std::move(memory.bytes);
}

namespace {

// The layout of the pixels of a TIFF photograph.
struct PhotographLayout {
  uint16_t samples = 1, bits = 1, format = SAMPLEFORMAT_UINT, photometric = PHOTOMETRIC_MINISBLACK;
  uint16_t planar = PLANARCONFIG_CONTIG, orientation = ORIENTATION_TOPLEFT;
  bool has_alpha = false;

  explicit PhotographLayout(TIFF* tiff) {
    TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &samples);
    TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &bits);
    TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLEFORMAT, &format);
    TIFFGetFieldDefaulted(tiff, TIFFTAG_PLANARCONFIG, &planar);
    TIFFGetFieldDefaulted(tiff, TIFFTAG_ORIENTATION, &orientation);
    TIFFGetField(tiff, TIFFTAG_PHOTOMETRIC, &photometric);
    uint16_t count = 0, *kinds = nullptr;
    TIFFGetFieldDefaulted(tiff, TIFFTAG_EXTRASAMPLES, &count, &kinds);
    has_alpha = count == 1 && kinds[0] != EXTRASAMPLE_UNSPECIFIED && IsPlain() && samples % 2 == 0;
  }
  bool IsUnsigned() const { return format == SAMPLEFORMAT_UINT || format == SAMPLEFORMAT_VOID; }
  // Whether the stored samples are grey or RGB values, pixel after pixel.
  bool IsPlain() const {
    if ((bits != 8 && bits != 16) || (planar != PLANARCONFIG_CONTIG && samples > 1)) return false;
    if (photometric == PHOTOMETRIC_RGB) return samples == 3 || samples == 4;
    return (photometric == PHOTOMETRIC_MINISBLACK && samples <= 2) ||
           (photometric == PHOTOMETRIC_MINISWHITE && samples == 1 && bits == 16);
  }
};

// Copies `width` pixels of `layout`, RGB, to grey, BGR or BGRA.
template <class Value>
void CopyPixels(const uint8_t* from, int width, const PhotographLayout& layout, int channels, uint8_t* to) {
  const auto* in = reinterpret_cast<const Value*>(from);
  auto* out = reinterpret_cast<Value*>(to);
  const int colours = layout.samples < 3 ? 1 : 3;
  for (int x = 0; x < width; ++x, in += layout.samples, out += channels) {
    for (int c = 0; c < std::min(channels, 3); ++c) out[c] = in[colours == 1 ? 0 : 2 - c];
    if (channels == 4) out[3] = in[colours];
  }
}

Status ReadPlainPixels(TIFF* tiff, const std::string& path, const PhotographLayout& layout, const std::string& error,
                       cv::Mat* image) {
  const int pixel_bytes = layout.samples * layout.bits / 8, channels = image->channels();
  const auto copy = [&](const uint8_t* from, int x, int y, int width) {
    uint8_t* to = image->ptr(y) + x * image->elemSize();
    if (layout.bits == 8) {
      CopyPixels<uint8_t>(from, width, layout, channels, to);
    } else {
      CopyPixels<uint16_t>(from, width, layout, channels, to);
    }
  };
  const auto damaged = [&](int y) {
    return InputError(path, absl::StrCat("row ", y), error.empty() ? "unreadable pixels" : error,
                      "an undamaged image: copy or export it again");
  };
  if (TIFFIsTiled(tiff)) {
    uint32_t width = 0, height = 0;
    TIFFGetField(tiff, TIFFTAG_TILEWIDTH, &width);
    TIFFGetField(tiff, TIFFTAG_TILELENGTH, &height);
    if (width == 0 || height == 0 || width > 8192 || height > 8192 ||
        TIFFTileSize(tiff) != static_cast<tmsize_t>(size_t{width} * height * pixel_bytes)) {
      return InputError(path, "", absl::StrCat("tiles of ", width, " x ", height, " pixels"),
                        "1 x 1 to 8192 x 8192");
    }
    std::vector<uint8_t> tile(TIFFTileSize(tiff));
    const int step_x = static_cast<int>(width), step_y = static_cast<int>(height);
    for (int y0 = 0; y0 < image->rows; y0 += step_y) {
      for (int x0 = 0; x0 < image->cols; x0 += step_x) {
        if (TIFFReadTile(tiff, tile.data(), x0, y0, 0, 0) < 0) return damaged(y0);
        for (int y = y0; y < std::min(image->rows, y0 + step_y); ++y) {
          copy(&tile[size_t(y - y0) * width * pixel_bytes], x0, y, std::min(step_x, image->cols - x0));
        }
      }
    }
    return absl::OkStatus();
  }
  std::vector<uint8_t> row(static_cast<size_t>(image->cols) * pixel_bytes);
  if (TIFFScanlineSize(tiff) != static_cast<tmsize_t>(row.size())) {
    return InputError(path, "", absl::StrCat("rows of ", TIFFScanlineSize(tiff), " bytes"), absl::StrCat(row.size()));
  }
  for (int y = 0; y < image->rows; ++y) {
    if (TIFFReadScanline(tiff, row.data(), y) < 0) return damaged(y);
    copy(row.data(), 0, y, image->cols);
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<TiffPhotographHeader> ReadTiffPhotographHeader(const std::string& path) {
  std::string error;
  const TiffPtr tiff = OpenTiff(path, &error);
  if (!tiff) return InputError(path, "", error, "a TIFF file");
  const TiffSize size = CurrentSize(tiff.get());
  if (size.width <= 0 || size.height <= 0) return InputError(path, "page 1", "no image size", "an image");
  const PhotographLayout layout(tiff.get());
  TiffPhotographHeader header = {size.width, size.height, layout.bits, layout.has_alpha, layout.orientation};
  uint16_t highest = 0;
  if (TIFFGetField(tiff.get(), TIFFTAG_MAXSAMPLEVALUE, &highest)) header.highest_sample = highest;
  return header;
}

Status DecodeTiffPhotograph(const std::string& path, cv::Mat* image) {
  std::string error;
  const TiffPtr tiff = OpenTiff(path, &error);
  if (!tiff) return InputError(path, "", error, "a TIFF file");
  const PhotographLayout layout(tiff.get());
  const TiffSize size = CurrentSize(tiff.get());
  const std::string samples = absl::StrCat(
      layout.bits, "-bit ", layout.format == SAMPLEFORMAT_INT ? "signed " : layout.IsUnsigned() ? "" : "float ");
  constexpr char kExpected[] = "8- or 16-bit unsigned samples: export the image in this format";
  if (!layout.IsUnsigned() || (layout.bits > 8 && layout.bits != 16)) {
    return InputError(path, "", absl::StrCat(samples, "samples"), kExpected);
  }
  if (layout.samples > 4) {
    return InputError(path, "", absl::StrCat(layout.samples, " samples a pixel"),
                      "grey or RGB: export the image with its red, green and blue bands only");
  }
  if (layout.IsPlain()) {
    const int channels = layout.has_alpha ? 4 : layout.samples < 3 ? 1 : 3;
    image->create(size.height, size.width, CV_MAKETYPE(layout.bits == 8 ? CV_8U : CV_16U, channels));
    return ReadPlainPixels(tiff.get(), path, layout, error, image);
  }
  if (layout.bits == 16) {
    return InputError(path, "", "16-bit samples that are not grey or RGB, pixel after pixel",
                      "16-bit grey or RGB: export the image in this format");
  }
  // Palettes, YCbCr, CMYK and others are converted by libtiff.
  TIFFSetField(tiff.get(), TIFFTAG_ORIENTATION, ORIENTATION_TOPLEFT);  // pixels as stored
  std::vector<uint32_t> raster(static_cast<size_t>(size.width) * size.height);
  if (!TIFFReadRGBAImageOriented(tiff.get(), size.width, size.height, raster.data(), ORIENTATION_TOPLEFT, 1)) {
    return InputError(path, "", error.empty() ? "a damaged TIFF image" : error,
                      "an undamaged grey or RGB image: export it again");
  }
  image->create(size.height, size.width, CV_8UC3);
  for (int y = 0; y < size.height; ++y) {
    uint8_t* row = image->ptr(y);
    for (int x = 0; x < size.width; ++x) {
      const uint32_t pixel = raster[static_cast<size_t>(y) * size.width + x];
      row[3 * x] = TIFFGetB(pixel);
      row[3 * x + 1] = TIFFGetG(pixel);
      row[3 * x + 2] = TIFFGetR(pixel);
    }
  }
  return absl::OkStatus();
}

}  // namespace tessera
