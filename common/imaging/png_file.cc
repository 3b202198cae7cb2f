#include "common/imaging/png_file.h"

#include <png.h>

#include <bit>
#include <cstdio>
#include <cstring>
#include <opencv2/core.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/imaging/file_bytes.h"

namespace tessera {
namespace {

// Reads one image. libpng reports errors by a callback that must not return; it jumps back into Read.
class PngReader {
 public:
  explicit PngReader(const std::vector<uint8_t>& bytes) : bytes_(bytes) {
    png_ = png_create_read_struct(
        PNG_LIBPNG_VER_STRING, this,
        [](png_structp png, png_const_charp message) {
          std::snprintf(Of(png).message_, sizeof Of(png).message_, "%s", message);
          png_longjmp(png, 1);
        },
        [](png_structp, png_const_charp) {});
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
  }
  ~PngReader() { png_destroy_read_struct(&png_, &info_, nullptr); }
  PngReader(const PngReader&) = delete;
  PngReader& operator=(const PngReader&) = delete;

  // False if the image is damaged. No local variable lives across the jump.
  bool Read(cv::Mat* image) {
    if (info_ == nullptr || setjmp(png_jmpbuf(png_)) != 0) return false;
    png_set_read_fn(png_, this, [](png_structp png, png_bytep out, size_t count) { Of(png).Take(out, count); });
    png_read_info(png_, info_);
    color_ = png_get_color_type(png_, info_);
    if (color_ == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png_);
    if (color_ == PNG_COLOR_TYPE_GRAY && png_get_bit_depth(png_, info_) < 8) png_set_expand_gray_1_2_4_to_8(png_);
    if (color_ == PNG_COLOR_TYPE_GRAY_ALPHA) png_set_gray_to_rgb(png_);
    if (color_ != PNG_COLOR_TYPE_GRAY && png_get_valid(png_, info_, PNG_INFO_tRNS) != 0) png_set_tRNS_to_alpha(png_);
    png_set_bgr(png_);
    if constexpr (std::endian::native == std::endian::little) png_set_swap(png_);
    png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    image->create(static_cast<int>(png_get_image_height(png_, info_)),
                  static_cast<int>(png_get_image_width(png_, info_)),
                  CV_MAKETYPE(png_get_bit_depth(png_, info_) == 16 ? CV_16U : CV_8U, png_get_channels(png_, info_)));
    if (png_get_rowbytes(png_, info_) != image->cols * image->elemSize()) return false;
    for (int y = 0; y < image->rows; ++y) rows_.push_back(image->ptr(y));
    png_read_image(png_, rows_.data());
    png_read_end(png_, nullptr);
    return true;
  }
  const char* message() const { return message_; }

 private:
  static PngReader& Of(png_structp png) { return *static_cast<PngReader*>(png_get_error_ptr(png)); }

  void Take(png_bytep out, size_t count) {
    if (count > bytes_.size() - at_) png_error(png_, "the file ends early");
    std::memcpy(out, bytes_.data() + at_, count);
    at_ += count;
  }

  const std::vector<uint8_t>& bytes_;
  size_t at_ = 0;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
  int color_ = 0;
  std::vector<png_bytep> rows_;
  char message_[128] = "";
};

// Writes one image into memory. Errors as in PngReader.
class PngWriter {
 public:
  PngWriter() {
    png_ = png_create_write_struct(
        PNG_LIBPNG_VER_STRING, this,
        [](png_structp png, png_const_charp message) {
          auto& writer = *static_cast<PngWriter*>(png_get_error_ptr(png));
          std::snprintf(writer.message_, sizeof writer.message_, "%s", message);
          png_longjmp(png, 1);
        },
        [](png_structp, png_const_charp) {});
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
  }
  ~PngWriter() { png_destroy_write_struct(&png_, &info_); }
  PngWriter(const PngWriter&) = delete;
  PngWriter& operator=(const PngWriter&) = delete;

  // `pixels`: interleaved samples, row by row. False on an error.
  bool Write(const std::vector<uint8_t>& pixels, int width, int height, int channels) {
    if (info_ == nullptr || setjmp(png_jmpbuf(png_)) != 0) return false;
    png_set_write_fn(
        png_, this,
        [](png_structp png, png_bytep data, size_t count) {
          auto& bytes = static_cast<PngWriter*>(png_get_io_ptr(png))->bytes_;
          bytes.insert(bytes.end(), data, data + count);
        },
        [](png_structp) {});
    png_set_filter(png_, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
    png_set_compression_level(png_, 1);
    png_set_compression_strategy(png_, 3);  // Z_RLE: fast, and good for pictures with equal neighbours
    png_set_IHDR(png_, info_, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height), 8,
                 channels == 3 ? PNG_COLOR_TYPE_RGB : PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png_, info_);
    for (int y = 0; y < height; ++y) png_write_row(png_, &pixels[size_t(y) * width * channels]);
    png_write_end(png_, info_);
    return true;
  }
  std::vector<uint8_t> TakeBytes() { return std::move(bytes_); }
  const char* message() const { return message_; }

 private:
  std::vector<uint8_t> bytes_;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
  char message_[128] = "";
};

}  // namespace

Status DecodePng(const std::string& path, const std::vector<uint8_t>& bytes, cv::Mat* image) {
  PngReader reader(bytes);
  if (reader.Read(image)) return absl::OkStatus();
  return InputError(path, "", absl::StrCat("a damaged PNG image (", reader.message(), ")"),
                    "an undamaged image: copy or export it again");
}

StatusOr<std::vector<uint8_t>> EncodePng(const ByteImage& image) {
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> samples, Interleaved(image));
  PngWriter writer;
  if (!writer.Write(samples, image.width, image.height, image.channels)) {
    return absl::InternalError(absl::StrCat("cannot encode a PNG image: ", writer.message()));
  }
  return writer.TakeBytes();
}

}  // namespace tessera
