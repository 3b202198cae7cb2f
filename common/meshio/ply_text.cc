#include <charconv>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "common/meshio/ply_body.h"

namespace tessera {
namespace {

bool IsBlank(char c) { return c == ' ' || c == '\t' || c == '\r'; }

// Reads one element per line; skips empty lines.
class TextReader {
 public:
  TextReader(ByteSource& source, const PlyHeader& header, const std::string& name, MeshSink& sink)
      : source_(source), header_(header), name_(name), sink_(sink), line_number_(header.lines) {}

  Status Read() {
    for (const PlyElement& element : header_.elements) {
      if (element.properties.empty()) continue;
      for (index_ = 0; index_ < element.count; ++index_) {
        if (!NextLine()) {
          ++line_number_;
          return Error(element, "the end of the file", absl::StrCat(element.count, " elements ", Quoted(element.name)));
        }
        TESSERA_RETURN_IF_ERROR(ReadElement(element));
      }
    }
    if (NextLine()) return InputError(name_, Place(), Quoted(rest_), "the end of the file");
    return source_.status();
  }

 private:
  bool NextLine() {
    while (source_.NextLine(rest_)) {
      ++line_number_;
      SkipBlanks();
      if (!rest_.empty()) return true;
    }
    return false;
  }

  void SkipBlanks() {
    size_t n = 0;
    while (n < rest_.size() && IsBlank(rest_[n])) ++n;
    rest_.remove_prefix(n);
  }

  // The next word of the line; empty if there is none.
  std::string_view Word() {
    size_t n = 0;
    while (n < rest_.size() && !IsBlank(rest_[n])) ++n;
    const std::string_view word = rest_.substr(0, n);
    rest_.remove_prefix(n);
    SkipBlanks();
    return word;
  }

  Status ReadElement(const PlyElement& element) {
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    Triangle triangle{};
    int32_t label = 0;
    for (const PlyProperty& property : element.properties) {
      const std::string_view word = Word();
      if (word.empty()) {
        return Error(element, "the end of the line", absl::StrCat("a value of ", Quoted(property.name)));
      }
      switch (property.role) {
        case PlyRole::kX:
        case PlyRole::kY:
        case PlyRole::kZ: {
          double& value = position[static_cast<int>(property.role) - static_cast<int>(PlyRole::kX)];
          if (!ToDouble(word, value) || !std::isfinite(value)) {
            return Error(element, absl::StrCat(property.name, " = ", Quoted(word)), "a finite number");
          }
          break;
        }
        case PlyRole::kIndices:
          TESSERA_RETURN_IF_ERROR(ReadIndices(element, word, triangle));
          break;
        case PlyRole::kLabel: {
          int64_t value = 0;
          if (!ToInteger(word, value) || value < -1 || value > std::numeric_limits<int32_t>::max()) {
            return Error(element, absl::StrCat("label ", Quoted(word)), "a class index, or -1 for no label");
          }
          label = static_cast<int32_t>(value);
          break;
        }
        case PlyRole::kOther:
          if (property.is_list) TESSERA_RETURN_IF_ERROR(SkipList(element, property, word));
          break;
      }
    }
    if (!rest_.empty()) return Error(element, absl::StrCat("extra text ", Quoted(rest_)), "the end of the line");
    if (element.kind == PlyElementKind::kVertex) sink_.AddVertex(position);
    if (element.kind == PlyElementKind::kFace) sink_.AddFace(triangle, label);
    return absl::OkStatus();
  }

  Status ReadIndices(const PlyElement& element, std::string_view count_word, Triangle& triangle) {
    int64_t count = 0;
    if (!ToInteger(count_word, count) || count != 3) {
      return Error(element, absl::StrCat("a face of ", Quoted(count_word), " vertices"), "3 (triangles only)");
    }
    for (uint32_t& corner : triangle) {
      const std::string_view word = Word();
      int64_t index = 0;
      if (word.empty()) return Error(element, "the end of the line", "a vertex index");
      if (!ToInteger(word, index) || index < 0 || index >= header_.vertex_count) {
        return Error(element, absl::StrCat("vertex index ", Quoted(word)),
                     absl::StrCat("an index below ", header_.vertex_count));
      }
      corner = static_cast<uint32_t>(index);
    }
    return absl::OkStatus();
  }

  Status SkipList(const PlyElement& element, const PlyProperty& property, std::string_view count_word) {
    int64_t count = 0;
    if (!ToInteger(count_word, count) || count < 0) {
      return Error(element, absl::StrCat("a list ", Quoted(property.name), " of ", Quoted(count_word), " values"),
                   "an integer of at least 0");
    }
    for (int64_t i = 0; i < count; ++i) {
      if (Word().empty()) {
        return Error(element, absl::StrCat("a list ", Quoted(property.name), " of ", i, " values"),
                     absl::StrCat(count, " values"));
      }
    }
    return absl::OkStatus();
  }

  static bool ToInteger(std::string_view word, int64_t& value) {
    if (word.size() > 1 && word[0] == '+' && word[1] != '-') word.remove_prefix(1);
    const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    return error == std::errc() && stop == word.data() + word.size();
  }

  static bool ToDouble(std::string_view word, double& value) {
    if (word.size() > 1 && word[0] == '+' && word[1] != '-') word.remove_prefix(1);
    const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (stop != word.data() + word.size()) return false;
    // strtod turns values out of range into zero or infinity.
    if (error == std::errc::result_out_of_range) value = std::strtod(std::string(word).c_str(), nullptr);
    return error == std::errc() || error == std::errc::result_out_of_range;
  }

  std::string Place() const { return absl::StrCat("line ", line_number_); }
  Status Error(const PlyElement& element, const std::string& found, const std::string& expected) const {
    if (!source_.status().ok()) return source_.status();
    return InputError(name_, absl::StrCat(Place(), " (", element.name, " ", index_, ")"), found, expected);
  }

  ByteSource& source_;
  const PlyHeader& header_;
  const std::string& name_;
  MeshSink& sink_;
  int64_t line_number_;
  int64_t index_ = 0;
  std::string_view rest_;
};

}  // namespace

Status ReadPlyText(ByteSource& source, const PlyHeader& header, const std::string& name, MeshSink& sink) {
  return TextReader(source, header, name, sink).Read();
}

}  // namespace tessera
