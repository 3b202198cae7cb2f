#include "common/meshio/ply_body.h"

#include <cmath>
#include <limits>
#include <string_view>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/meshio/text_words.h"

namespace tessera {
namespace {

constexpr int64_t kMaxTrailingBytes = 16;

// Reads one element per line; skips empty lines.
class TextReader {
 public:
  TextReader(ByteSource& source, const PlyHeader& header, const std::string& name, const MeshReadOptions& options,
             MeshSink& sink)
      : source_(source),
        header_(header),
        name_(name),
        options_(options),
        sink_(sink),
        fan_(sink),
        line_number_(header.lines) {}

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
    SkipBlankLines();
    TESSERA_RETURN_IF_ERROR(CheckPlyEnd(source_, name_, absl::StrCat("line ", line_number_ + 1), options_));
    fan_.Warn("line", options_);
    return absl::OkStatus();
  }

 private:
  bool NextLine() {
    while (source_.NextLine(rest_)) {
      ++line_number_;
      SkipBlanks(rest_);
      if (!rest_.empty()) return true;
    }
    return false;
  }

  // Moves to the next character of the source that is no blank.
  void SkipBlankLines() {
    for (const char* next = source_.Peek(1); next != nullptr && (IsBlank(*next) || *next == '\n');
         next = source_.Peek(1)) {
      if (*next == '\n') ++line_number_;
      source_.Advance(1);
    }
  }

  Status ReadElement(const PlyElement& element) {
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    int32_t label = 0;
    for (const PlyProperty& property : element.properties) {
      const std::string_view word = TakeWord(rest_);
      if (word.empty()) {
        return Error(element, "the end of the line", absl::StrCat("a value of ", Quoted(property.name)));
      }
      switch (property.role) {
        case PlyRole::kX:
        case PlyRole::kY:
        case PlyRole::kZ: {
          double& value = position[static_cast<int>(property.role) - static_cast<int>(PlyRole::kX)];
          if (!ParseNumber(word, value) || !std::isfinite(value)) {
            return Error(element, absl::StrCat(property.name, " = ", Quoted(word)), "a finite number");
          }
          break;
        }
        case PlyRole::kIndices:
          TESSERA_RETURN_IF_ERROR(ReadIndices(element, word));
          break;
        case PlyRole::kLabel: {
          int64_t integer = 0;
          double number = 0;
          const bool good = IsInteger(property.type) ? ParseInteger(word, integer) && LabelOf(integer, label)
                                                     : ParseNumber(word, number) && LabelOf(number, label);
          if (!good) return Error(element, absl::StrCat("label ", Quoted(word)), ExpectedLabel(header_, options_));
          break;
        }
        case PlyRole::kConfidence: {
          double confidence = 0;
          if (!ParseNumber(word, confidence)) {
            return Error(element, absl::StrCat("confidence ", Quoted(word)), "a number");
          }
          sink_.SetConfidence(static_cast<float>(confidence));
          break;
        }
        case PlyRole::kOther:
          if (property.is_list) TESSERA_RETURN_IF_ERROR(SkipList(element, property, word));
          break;
      }
    }
    if (!rest_.empty()) return Error(element, absl::StrCat("extra text ", Quoted(rest_)), "the end of the line");
    if (element.kind == PlyElementKind::kVertex) sink_.AddVertex(position, label);
    if (element.kind == PlyElementKind::kFace) fan_.AddFace(vertices_, label, line_number_);
    return absl::OkStatus();
  }

  // Reads the face's vertices_.
  Status ReadIndices(const PlyElement& element, std::string_view count_word) {
    int64_t count = 0;
    if (!ParseInteger(count_word, count) || count < 3 || count > kMaxFaceVertices) {
      return Error(element, absl::StrCat("a face of ", Quoted(count_word), " vertices"), ExpectedVertexCount());
    }
    vertices_.resize(static_cast<size_t>(count));
    for (uint32_t& vertex : vertices_) {
      const std::string_view word = TakeWord(rest_);
      int64_t index = 0;
      if (word.empty()) return Error(element, "the end of the line", "a vertex index");
      if (!ParseInteger(word, index) || index < 0 || index >= header_.vertex_count) {
        return Error(element, absl::StrCat("vertex index ", Quoted(word)),
                     absl::StrCat("an index below ", header_.vertex_count));
      }
      vertex = static_cast<uint32_t>(index);
    }
    return absl::OkStatus();
  }

  Status SkipList(const PlyElement& element, const PlyProperty& property, std::string_view count_word) {
    int64_t count = 0;
    if (!ParseInteger(count_word, count) || count < 0) {
      return Error(element, absl::StrCat("a list ", Quoted(property.name), " of ", Quoted(count_word), " values"),
                   "an integer of at least 0");
    }
    for (int64_t i = 0; i < count; ++i) {
      if (TakeWord(rest_).empty()) {
        return Error(element, absl::StrCat("a list ", Quoted(property.name), " of ", i, " values"),
                     absl::StrCat(count, " values"));
      }
    }
    return absl::OkStatus();
  }

  Status Error(const PlyElement& element, const std::string& found, const std::string& expected) const {
    if (!source_.status().ok()) return source_.status();
    return InputError(name_, absl::StrCat("line ", line_number_, " (", element.name, " ", index_, ")"), found,
                      expected);
  }

  ByteSource& source_;
  const PlyHeader& header_;
  const std::string& name_;
  const MeshReadOptions& options_;
  MeshSink& sink_;
  PolygonFan fan_;
  std::vector<uint32_t> vertices_;  // of the face
  int64_t line_number_;
  int64_t index_ = 0;
  std::string_view rest_;
};

}  // namespace

Status CheckPlyEnd(ByteSource& source, const std::string& name, const std::string& place,
                   const MeshReadOptions& options) {
  const bool at_end = source.AtEnd();
  TESSERA_RETURN_IF_ERROR(source.status());
  if (at_end) return absl::OkStatus();
  const int64_t left = source.size_bytes() - source.offset_bytes();
  if (left > kMaxTrailingBytes) {
    return InputError(name, place, absl::StrCat(left, " bytes after the last element"), "the end of the file");
  }
  options.Warn(absl::StrCat(left, left == 1 ? " byte" : " bytes", " after the last element ignored (", place, ")"));
  return absl::OkStatus();
}

bool LabelOf(int64_t value, int32_t& label) {
  if (value < -1 || value > std::numeric_limits<int32_t>::max()) return false;
  label = static_cast<int32_t>(value);
  return true;
}

bool LabelOf(double value, int32_t& label) {
  // NaN is unequal to itself.
  if (value != std::floor(value) || value < -1 || value > std::numeric_limits<int32_t>::max()) return false;
  label = static_cast<int32_t>(value);
  return true;
}

std::string ExpectedLabel(const PlyHeader& header, const MeshReadOptions& options) {
  // A property of another name may hold something else.
  return absl::StrCat("a class index (a whole number), or -1 for no label",
                      header.label_property == "label" ? ""
                                                       : absl::StrCat("; if ", Quoted(header.label_property),
                                                                      " holds no labels, ", options.without_labels));
}

Status ReadPlyText(ByteSource& source, const PlyHeader& header, const std::string& name, const MeshReadOptions& options,
                   MeshSink& sink) {
  return TextReader(source, header, name, options, sink).Read();
}

}  // namespace tessera
