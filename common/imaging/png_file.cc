#include "common/imaging/png_file.h"

#include <png.h>

#include <bit>
#include <cstdio>
#include <cstring>
#include <opencv2/core.hpp>

#include "absl/strings/str_cat.h"

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

}  // namespace

Status DecodePng(const std::string& path, const std::vector<uint8_t>& bytes, cv::Mat* image) {
  PngReader reader(bytes);
  if (reader.Read(image)) return absl::OkStatus();
  return InputError(path, "", absl::StrCat("a damaged PNG image (", reader.message(), ")"),
                    "an undamaged image: copy or export it again");
}

}  // namespace tessera
