#include "common/imaging/npy.h"

#include <Eigen/Core>
#include <cctype>
#include <cstring>
#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace tessera {
namespace {

// The header: a Python dictionary literal with exactly the keys descr, fortran_order and shape.
struct NpyHeader {
  std::optional<std::string> descr;
  std::optional<bool> fortran_order;
  std::optional<std::vector<int64_t>> shape;
};

class HeaderParser {
 public:
  explicit HeaderParser(const std::string& text) : text_(text) {}
  size_t position() const { return at_; }

  bool Parse(NpyHeader* header) {
    if (!Take('{')) return false;
    while (!Take('}')) {
      std::string key;
      if (!String(&key) || !Take(':') || !Value(key, header)) return false;
      if (!Take(',') && !Peek('}')) return false;
    }
    Space();
    return at_ == text_.size();
  }

 private:
  void Space() {
    while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_]))) ++at_;
  }
  bool Peek(char c) {
    Space();
    return at_ < text_.size() && text_[at_] == c;
  }
  bool Take(char c) { return Peek(c) ? (++at_, true) : false; }
  bool Word(const char* word) {
    Space();
    if (text_.compare(at_, std::strlen(word), word) != 0) return false;
    at_ += std::strlen(word);
    return true;
  }
  bool String(std::string* out) {
    Space();
    if (at_ >= text_.size() || (text_[at_] != '\'' && text_[at_] != '"')) return false;
    const size_t end = text_.find(text_[at_], at_ + 1);
    if (end == std::string::npos) return false;
    *out = text_.substr(at_ + 1, end - at_ - 1);
    at_ = end + 1;
    return true;
  }
  bool Number(int64_t* out) {
    Space();
    const size_t begin = at_;
    *out = 0;
    while (at_ < text_.size() && std::isdigit(static_cast<unsigned char>(text_[at_])) && at_ - begin < 15) {
      *out = *out * 10 + (text_[at_++] - '0');
    }
    return at_ > begin;
  }
  bool Value(const std::string& key, NpyHeader* header) {
    if (key == "descr") return String(&header->descr.emplace());
    if (key == "fortran_order") {
      if (Word("True")) return header->fortran_order.emplace(true);
      return Word("False") ? (header->fortran_order = false, true) : false;
    }
    if (key != "shape" || !Take('(')) return false;
    std::vector<int64_t>& shape = header->shape.emplace();
    while (!Take(')')) {
      int64_t size = 0;
      if (!Number(&size)) return false;
      shape.push_back(size);
      if (!Take(',') && !Peek(')')) return false;
    }
    return true;
  }

  const std::string& text_;
  size_t at_ = 0;
};

}  // namespace

StatusOr<NpyArray> FindNpyArray(const std::vector<uint8_t>& bytes, const std::string& name) {
  if (bytes.size() < 10 || std::memcmp(bytes.data(), "\x93NUMPY", 6) != 0) {
    return InputError(name, "byte 0", "no NPY signature", "an NPY file");
  }
  const int version = bytes[6];
  if (version < 1 || version > 3) return InputError(name, "byte 6", absl::StrCat("version ", version), "1, 2 or 3");
  const size_t start = version == 1 ? 10 : 12;
  if (bytes.size() < start)
    return InputError(name, absl::StrCat("byte ", bytes.size()), "the end of the file", "a header length");
  size_t length = bytes[8] + 256 * bytes[9];
  if (version > 1) length += (size_t{bytes[10]} << 16) + (size_t{bytes[11]} << 24);
  if (length > bytes.size() - start) {
    return InputError(name, "byte 8", absl::StrCat("a header of ", length, " bytes"),
                      absl::StrCat("at most ", bytes.size() - start, " (the rest of the file)"));
  }
  const std::string text(bytes.begin() + start, bytes.begin() + start + length);
  NpyHeader header;
  HeaderParser parser(text);
  if (!parser.Parse(&header) || !header.descr || !header.fortran_order || !header.shape) {
    return InputError(name, absl::StrCat("byte ", start + parser.position()), "a malformed header",
                      "a Python dictionary: {'descr': ..., 'fortran_order': ..., 'shape': (...)}");
  }
  if (*header.fortran_order) return InputError(name, "header", "fortran_order True", "False (C order)");
  const int value_bytes = *header.descr == "|u1" || *header.descr == "u1" ? 1
                          : *header.descr == "<f2"                        ? 2
                          : *header.descr == "<f4"                        ? 4
                                                                          : 0;
  if (value_bytes == 0) {
    return InputError(name, "header", absl::StrCat("descr '", *header.descr, "'"),
                      "'|u1', '<f2' or '<f4' (uint8, float16, float32)");
  }
  const std::vector<int64_t>& shape = *header.shape;
  const std::string shape_text = absl::StrCat("shape (", absl::StrJoin(shape, ", "), ")");
  if (shape.size() != 3) return InputError(name, "header", shape_text, "shape (classes, height, width)");
  const uint8_t* values = bytes.data() + start + length;
  const size_t available = bytes.size() - start - length;
  // Divide instead of multiplying, because the product of corrupt sizes may overflow.
  size_t left = available / value_bytes;
  bool fits = available % value_bytes == 0;
  for (const int64_t size : shape) {
    fits = fits && size > 0 && left % size == 0;
    if (fits) left /= size;
  }
  if (!fits || left != 1) {
    return InputError(name, absl::StrCat("byte ", start + length), absl::StrCat(available, " bytes of values"),
                      absl::StrCat("the size of ", shape_text, " with ", value_bytes, "-byte values"));
  }
  return NpyArray{static_cast<int>(shape[0]), static_cast<int>(shape[1]), static_cast<int>(shape[2]), value_bytes,
                  values};
}

FloatImage NpyPart(const NpyArray& array, const ImagePart& part) {
  FloatImage image(part.width(), part.height(), array.channels);
  float* out = image.data.data();
  for (int c = 0; c < array.channels; ++c) {
    for (int y = part.y0; y < part.y1; ++y) {
      const size_t row = (static_cast<size_t>(c) * array.height + y) * array.width;
      for (int x = part.x0; x < part.x1; ++x) {
        const uint8_t* value = array.values + (row + x) * array.value_bytes;
        if (array.value_bytes == 1) {
          *out++ = *value;
        } else if (array.value_bytes == 2) {
          *out++ = Eigen::half_impl::half_to_float(
              Eigen::half_impl::raw_uint16_to_half(static_cast<uint16_t>(value[0] + 256 * value[1])));
        } else {
          std::memcpy(out++, value, 4);
        }
      }
    }
  }
  return image;
}

}  // namespace tessera
