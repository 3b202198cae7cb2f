#include "common/blocks/metashape/ply_columns.h"

#include <charconv>
#include <cstdint>
#include <cstring>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"

namespace tessera {
namespace {

constexpr size_t kMaxPlyHeaderBytes = 1 << 16;

template <class T>
double PlyColumnValue(const char* at) {
  T value;
  std::memcpy(&value, at, sizeof(value));
  return static_cast<double>(value);
}

struct PlyColumnType {
  std::string_view name, other_name;
  size_t bytes;
  double (*read)(const char* at);
};

constexpr PlyColumnType kPlyColumnTypes[] = {
    {"char", "int8", 1, PlyColumnValue<int8_t>},    {"uchar", "uint8", 1, PlyColumnValue<uint8_t>},
    {"short", "int16", 2, PlyColumnValue<int16_t>}, {"ushort", "uint16", 2, PlyColumnValue<uint16_t>},
    {"int", "int32", 4, PlyColumnValue<int32_t>},   {"uint", "uint32", 4, PlyColumnValue<uint32_t>},
    {"float", "float32", 4, PlyColumnValue<float>}, {"double", "float64", 8, PlyColumnValue<double>}};

std::vector<std::string_view> PlyColumnWords(std::string_view line) {
  std::vector<std::string_view> words;
  for (size_t begin = line.find_first_not_of(" \r"); begin != std::string_view::npos;) {
    const size_t end = std::min(line.find_first_of(" \r", begin), line.size());
    words.push_back(line.substr(begin, end - begin));
    begin = line.find_first_not_of(" \r", end);
  }
  return words;
}

}  // namespace

StatusOr<std::vector<std::vector<double>>> ParsePlyColumns(std::string_view bytes, const std::string& file,
                                                           const std::vector<std::string>& names) {
  const auto error = [&](int line, const std::string& found, const std::string& expected) {
    return InputError(file, absl::StrCat("line ", line), found, expected);
  };
  struct Column {
    size_t offset = 0;
    const PlyColumnType* type = nullptr;
  };
  std::vector<Column> columns(names.size());
  size_t stride = 0, at = 0;
  int elements = 0, line_number = 0;
  uint64_t count = 0;
  for (bool ended = false; !ended;) {
    ++line_number;
    const size_t end = bytes.substr(0, kMaxPlyHeaderBytes).find('\n', at);
    if (end == std::string_view::npos) return error(line_number, "no end of the header", "end_header");
    const std::vector<std::string_view> words = PlyColumnWords(bytes.substr(at, end - at));
    at = end + 1;
    const auto is = [&](size_t i, std::string_view word) { return i < words.size() && words[i] == word; };
    if (line_number == 1 && !is(0, "ply")) return error(1, "no PLY file", "the line ply");
    if (is(0, "format") && !is(1, "binary_little_endian"))
      return error(line_number, "another format", "binary_little_endian");
    ended = is(0, "end_header");
    if (is(0, "element") && ++elements == 1) {
      const std::string_view number = words.size() == 3 ? words[2] : "";
      const auto [stop, failure] = std::from_chars(number.data(), number.data() + number.size(), count);
      if (number.empty() || failure != std::errc() || stop != number.data() + number.size())
        return error(line_number, "no count", "element NAME COUNT");
    }
    if (!is(0, "property") || elements != 1) continue;
    const PlyColumnType* type = nullptr;
    for (const PlyColumnType& known : kPlyColumnTypes) {
      if (is(1, known.name) || is(1, known.other_name)) type = &known;
    }
    if (type == nullptr || words.size() != 3)
      return error(line_number, "a list or an unknown type", "property TYPE NAME");
    for (size_t i = 0; i < names.size(); ++i) {
      if (words[2] == names[i] || std::string(words[2]) + "?" == names[i]) columns[i] = {stride, type};
    }
    stride += type->bytes;
  }
  if (stride == 0 || count > (bytes.size() - at) / stride) {
    return InputError(file, "", absl::StrCat(bytes.size() - at, " bytes for ", count, " rows of ", stride),
                      "a whole file; it is cut off or damaged");
  }
  if (elements == 1 && count * stride != bytes.size() - at) {
    return InputError(file, "", absl::StrCat(bytes.size() - at - count * stride, " bytes after the last row"), "none");
  }
  std::vector<std::vector<double>> values(names.size());
  for (size_t i = 0; i < names.size(); ++i) {
    if (columns[i].type == nullptr) {
      if (names[i].ends_with('?')) continue;
      return InputError(file, "header", absl::StrCat("no property ", names[i]), "one");
    }
    values[i].reserve(count);
    for (uint64_t row = 0; row < count; ++row) {
      values[i].push_back(columns[i].type->read(bytes.data() + at + row * stride + columns[i].offset));
    }
  }
  return values;
}

}  // namespace tessera
