#include "common/imaging/jpeg_file.h"

#include <csetjmp>
#include <cstdio>
// libjpeg's headers need <cstdio>,
#include <jpeglib.h>
// and the numbers of jerror.h depend on jpeglib.h.
#include <jerror.h>

#include <algorithm>
#include <cstdlib>

#include "absl/strings/str_cat.h"
#include "common/imaging/file_bytes.h"

namespace tessera {
namespace {

// Converts `width` pixels. The samples are inverted, as Adobe's programs write them.
void CmykToBgr(const uint8_t* cmyk, int width, uint8_t* bgr) {
  for (int x = 0; x < width; ++x, cmyk += 4, bgr += 3) {
    const int black = cmyk[3];
    for (int c = 0; c < 3; ++c) bgr[2 - c] = static_cast<uint8_t>(black - ((255 - cmyk[c]) * black >> 8));
  }
}

// Reads one image. libjpeg reports errors by callbacks that must not return; they jump back into Read.
class JpegReader {
 public:
  JpegReader() {
    info_.err = jpeg_std_error(&errors_);
    errors_.error_exit = [](j_common_ptr info) { Of(info).Stop(); };
    errors_.emit_message = [](j_common_ptr info, int level) {
      if (level < 0 && Of(info).ReportsDamage()) Of(info).Stop();
    };
    errors_.output_message = [](j_common_ptr) {};
    info_.client_data = this;
  }
  ~JpegReader() { jpeg_destroy_decompress(&info_); }
  JpegReader(const JpegReader&) = delete;
  JpegReader& operator=(const JpegReader&) = delete;

  // False if the image is damaged or has another size. No local variable lives across the jump.
  bool Read(const std::vector<uint8_t>& bytes, const BgrRows& rows) {
    begin_ = bytes.data();
    if (setjmp(stopped_) != 0) return false;
    jpeg_create_decompress(&info_);
    jpeg_mem_src(&info_, bytes.data(), bytes.size());
    jpeg_read_header(&info_, TRUE);
    // The other settings are libjpeg's defaults, as in OpenCV.
    info_.out_color_space = IsCmyk() ? JCS_CMYK : JCS_EXT_BGR;
    jpeg_start_decompress(&info_);
    if (static_cast<int64_t>(info_.output_width) != rows.width ||
        static_cast<int64_t>(info_.output_height) != rows.height) {
      return false;
    }
    if (IsCmyk()) {
      cmyk_ =
          (*info_.mem->alloc_sarray)(reinterpret_cast<j_common_ptr>(&info_), JPOOL_IMAGE, 4 * info_.output_width, 1);
    }
    while (info_.output_scanline < info_.output_height) {
      uint8_t* const out = rows.data + rows.stride_bytes * info_.output_scanline;
      JSAMPROW row = IsCmyk() ? cmyk_[0] : out;
      jpeg_read_scanlines(&info_, &row, 1);
      if (IsCmyk()) CmykToBgr(row, rows.width, out);
    }
    jpeg_finish_decompress(&info_);  // reads on to the end of the image
    return true;
  }

  // Why Read returned false.
  Status Fault(const std::string& path) const {
    if (message_[0] == '\0') {
      return InputError(path, "", absl::StrCat(info_.output_width, " x ", info_.output_height, " pixels when decoded"),
                        "the size in the header");
    }
    // Damage shows late: the decoder goes on with wrong pixels until the data do not add up.
    return InputError(path, "",
                      absl::StrCat("a damaged JPEG image (", static_cast<const char*>(message_),
                                   row_ > 0 && row_ < info_.output_height
                                       ? absl::StrCat(", at or before row ", row_, " of ", info_.output_height)
                                       : "",
                                   ")"),
                      "an undamaged image: copy or export it again");
  }

 private:
  bool IsCmyk() const { return info_.num_components == 4; }
  static JpegReader& Of(j_common_ptr info) { return *static_cast<JpegReader*>(info->client_data); }

  [[noreturn]] void Stop() {
    errors_.format_message(reinterpret_cast<j_common_ptr>(&info_), message_);
    row_ = info_.output_scanline;
    std::longjmp(stopped_, 1);
  }
  // Whether the warning that libjpeg is about to emit means that pixels are wrong.
  bool ReportsDamage() const {
    switch (errors_.msg_code) {
      case JWRN_HIT_MARKER:
      case JWRN_HUFF_BAD_CODE:
      case JWRN_ARITH_BAD_CODE:
      case JWRN_JPEG_EOF:
      case JWRN_MUST_RESYNC:
        return true;
      case JWRN_EXTRANEOUS_DATA:
        return !IsPadding(errors_.msg_parm.i[0]);
      default:
        return false;
    }
  }
  // Whether the `count` bytes that libjpeg has skipped are equal. Damage leaves a rest of the image data instead.
  bool IsPadding(int count) const {
    const JOCTET* const end = info_.src->next_input_byte;  // libjpeg has not yet moved it beyond the marker
    if (count <= 0 || end - begin_ < count) return false;
    return std::all_of(end - count, end, [&](JOCTET byte) { return byte == end[-1]; });
  }

  jpeg_decompress_struct info_ = {};
  jpeg_error_mgr errors_ = {};
  std::jmp_buf stopped_;
  const uint8_t* begin_ = nullptr;
  JSAMPARRAY cmyk_ = nullptr;  // a row of a CMYK image
  JDIMENSION row_ = 0;
  char message_[JMSG_LENGTH_MAX] = {};
};

// Writes one image into memory. Errors as in JpegReader.
class JpegWriter {
 public:
  JpegWriter() {
    info_.err = jpeg_std_error(&errors_);
    errors_.error_exit = [](j_common_ptr info) {
      JpegWriter& writer = *static_cast<JpegWriter*>(info->client_data);
      writer.errors_.format_message(info, writer.message_);
      std::longjmp(writer.stopped_, 1);
    };
    errors_.output_message = [](j_common_ptr) {};
    info_.client_data = this;
  }
  ~JpegWriter() {
    jpeg_destroy_compress(&info_);
    std::free(bytes_);
  }
  JpegWriter(const JpegWriter&) = delete;
  JpegWriter& operator=(const JpegWriter&) = delete;

  // `pixels`: interleaved samples, row by row. False on an error.
  bool Write(const std::vector<uint8_t>& pixels, int width, int height, int channels, int quality) {
    if (setjmp(stopped_) != 0) return false;
    jpeg_create_compress(&info_);
    jpeg_mem_dest(&info_, &bytes_, &size_);
    info_.image_width = static_cast<JDIMENSION>(width);
    info_.image_height = static_cast<JDIMENSION>(height);
    info_.input_components = channels;
    info_.in_color_space = channels == 3 ? JCS_RGB : JCS_GRAYSCALE;
    jpeg_set_defaults(&info_);
    jpeg_set_quality(&info_, quality, TRUE);
    jpeg_start_compress(&info_, TRUE);
    while (info_.next_scanline < info_.image_height) {
      // The const_cast is safe: libjpeg does not change its input.
      auto* row = const_cast<uint8_t*>(&pixels[size_t{info_.next_scanline} * width * channels]);
      jpeg_write_scanlines(&info_, &row, 1);
    }
    jpeg_finish_compress(&info_);
    return true;
  }
  std::vector<uint8_t> Bytes() const { return {bytes_, bytes_ + size_}; }
  const char* message() const { return message_; }

 private:
  jpeg_compress_struct info_ = {};
  jpeg_error_mgr errors_ = {};
  std::jmp_buf stopped_;
  unsigned char* bytes_ = nullptr;
  unsigned long size_ = 0;  // the type that libjpeg asks for
  char message_[JMSG_LENGTH_MAX] = {};
};

}  // namespace

Status DecodeJpeg(const std::string& path, const std::vector<uint8_t>& bytes, const BgrRows& rows) {
  JpegReader reader;
  return reader.Read(bytes, rows) ? absl::OkStatus() : reader.Fault(path);
}

StatusOr<std::vector<uint8_t>> EncodeJpeg(const ByteImage& image, int quality) {
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> samples, Interleaved(image));
  JpegWriter writer;
  if (!writer.Write(samples, image.width, image.height, image.channels, quality)) {
    return absl::InternalError(absl::StrCat("cannot encode a JPEG image: ", writer.message()));
  }
  return writer.Bytes();
}

}  // namespace tessera
