#include "common/imaging/npy.h"

#include <Eigen/Core>
#include <cctype>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>

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

// Sets kind, value_bytes and big_endian. False for other types.
bool ParseDescr(const std::string& descr, NpyArray* array) {
  const bool has_order = !descr.empty() && std::strchr("<>|=", descr[0]) != nullptr;
  const std::string type = descr.substr(has_order ? 1 : 0);
  if (type.size() != 2 || std::strchr("biuf", type[0]) == nullptr || std::strchr("1248", type[1]) == nullptr) {
    return false;
  }
  array->kind = type[0] == 'b' ? 'u' : type[0];
  array->value_bytes = type[1] - '0';
  array->big_endian = descr[0] == '>';
  return type[0] == 'b' ? type[1] == '1' : type[0] != 'f' || type[1] != '1';
}

// The value at `bytes` as a number of the same size, in the order of this machine (little-endian).
template <class Stored>
Stored Load(const uint8_t* bytes, bool big_endian) {
  Stored value;
  if (!big_endian) {
    std::memcpy(&value, bytes, sizeof value);
    return value;
  }
  uint8_t turned[sizeof value];
  for (size_t i = 0; i < sizeof value; ++i) turned[i] = bytes[sizeof value - 1 - i];
  std::memcpy(&value, turned, sizeof value);
  return value;
}

// Calls take(value) for the values of `part`, plane by plane, row by row.
template <class Stored, class Take>
void ForEachValue(const NpyArray& array, const ImagePart& part, int channels, const Take& take) {
  for (int c = 0; c < channels; ++c) {
    for (int y = part.y0; y < part.y1; ++y) {
      const int64_t row = c * array.plane_stride + y * array.row_stride;
      for (int x = part.x0; x < part.x1; ++x) {
        const uint8_t* value = array.values + (row + x * array.column_stride) * array.value_bytes;
        take(Load<Stored>(value, array.big_endian));
      }
    }
  }
}

struct Half {
  uint16_t bits;
};

// Calls take(value) with the file's type of number; with Half for float16.
template <class Take>
void ForEachValue(const NpyArray& array, const ImagePart& part, int channels, const Take& take) {
  const auto of_size = [&]<class One, class Two, class Four, class Eight>(One, Two, Four, Eight) {
    if (array.value_bytes == 1) return ForEachValue<One>(array, part, channels, take);
    if (array.value_bytes == 2) return ForEachValue<Two>(array, part, channels, take);
    if (array.value_bytes == 4) return ForEachValue<Four>(array, part, channels, take);
    ForEachValue<Eight>(array, part, channels, take);
  };
  if (array.kind == 'u') return of_size(uint8_t(), uint16_t(), uint32_t(), uint64_t());
  if (array.kind == 'i') return of_size(int8_t(), int16_t(), int32_t(), int64_t());
  of_size(uint8_t(), Half(), float(), double());
}

}  // namespace

StatusOr<NpyArray> FindNpyArray(const std::vector<uint8_t>& bytes, const std::string& name,
                                std::optional<size_t> file_bytes) {
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
  NpyArray array;
  if (!ParseDescr(*header.descr, &array)) {
    return InputError(name, "header", absl::StrCat("descr '", *header.descr, "'"),
                      "whole numbers or floats, such as '|u1', '<i8' or '<f4' (uint8, int64, float32)");
  }
  std::vector<int64_t> shape = *header.shape;
  const std::string shape_text = absl::StrCat("shape (", absl::StrJoin(shape, ", "), ")");
  if (shape.size() == 4 && shape[0] == 1) shape.erase(shape.begin());
  array.axes = static_cast<int>(shape.size());
  if (array.axes != 2 && array.axes != 3) {
    return InputError(name, "header", shape_text,
                      "shape (classes, height, width) or (height, width, classes); (height, width) of class ids");
  }
  array.values = bytes.data() + start + length;
  const size_t available = file_bytes.value_or(bytes.size()) - start - length;
  // Divide instead of multiplying, because the product of corrupt sizes may overflow.
  size_t left = available / array.value_bytes;
  bool fits = available % array.value_bytes == 0;
  for (const int64_t size : shape) {
    fits = fits && size > 0 && size <= std::numeric_limits<int>::max() && left % size == 0;
    if (fits) left /= size;
  }
  if (!fits || left != 1) {
    return InputError(name, absl::StrCat("byte ", start + length), absl::StrCat(available, " bytes of values"),
                      absl::StrCat("the size of ", shape_text, " with ", array.value_bytes, "-byte values"));
  }
  if (array.axes == 2) shape.insert(shape.begin(), 1);
  array.channels = static_cast<int>(shape[0]);
  array.height = static_cast<int>(shape[1]);
  array.width = static_cast<int>(shape[2]);
  array.plane_stride = *header.fortran_order ? 1 : shape[1] * shape[2];
  array.row_stride = *header.fortran_order ? shape[0] : shape[2];
  array.column_stride = *header.fortran_order ? shape[0] * shape[1] : 1;
  return array;
}

NpyArray ChannelsLast(const NpyArray& array) {
  NpyArray out = array;
  out.height = array.channels;
  out.width = array.height;
  out.channels = array.width;
  out.row_stride = array.plane_stride;
  out.column_stride = array.row_stride;
  out.plane_stride = array.column_stride;
  return out;
}

bool IsIdArray(const NpyArray& array, int classes) {
  return array.kind != 'f' && (array.axes == 2 || (classes > 1 && (array.channels == 1 || array.width == 1)));
}

FloatImage NpyPart(const NpyArray& array, const ImagePart& part) {
  FloatImage image(part.width(), part.height(), array.channels);
  float* out = image.data.data();
  ForEachValue(array, part, array.channels, [&](auto value) {
    if constexpr (std::is_same_v<decltype(value), Half>) {
      *out++ = Eigen::half_impl::half_to_float(Eigen::half_impl::raw_uint16_to_half(value.bits));
    } else {
      *out++ = static_cast<float>(value);
    }
  });
  return image;
}

Raster<uint32_t> NpyIds(const NpyArray& array) {
  constexpr uint32_t kMost = std::numeric_limits<int32_t>::max();
  Raster<uint32_t> ids(array.width, array.height);
  uint32_t* out = ids.data.data();
  ForEachValue(array, {0, 0, array.width, array.height}, 1, [&](auto value) {
    if constexpr (std::is_integral_v<decltype(value)>) {
      *out++ = std::cmp_less(value, 0) ? ~0u : std::cmp_greater(value, kMost) ? kMost : static_cast<uint32_t>(value);
    }
  });
  return ids;
}

}  // namespace tessera
