#include "common/meshio/obj.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/meshio/byte_source.h"
#include "common/meshio/text_words.h"

namespace tessera {
namespace {

constexpr size_t kMaxLineBytes = size_t{1} << 20;
constexpr int64_t kMaxObjVertices = std::numeric_limits<uint32_t>::max();
constexpr int64_t kLeastTriangleBytes = 2;  // a digit and a separator in a face of many vertices

// Statements that do not change the surface.
constexpr std::array<std::string_view, 19> kSkippedStatements = {
    "vt", "vn",     "vp",     "o",   "g",     "s",        "mg",       "usemtl",     "mtllib",   "l",
    "p",  "usemap", "maplib", "lod", "bevel", "c_interp", "d_interp", "shadow_obj", "trace_obj"};

bool IsSkippedStatement(std::string_view keyword) {
  return std::find(kSkippedStatements.begin(), kSkippedStatements.end(), keyword) != kSkippedStatements.end();
}

class ObjReader {
 public:
  ObjReader(ByteSource& source, const std::string& name, const MeshReadOptions& options, MeshSink& sink)
      : source_(source), name_(name), options_(options), sink_(sink), fan_(sink) {}

  Status Read() {
    if (options_.materials == nullptr && options_.label_property && !options_.label_property->empty()) {
      return InputError(name_, "", "an OBJ file, which has no properties",
                        absl::StrCat("a PLY with the property ", Quoted(*options_.label_property), ", which ",
                                     options_.label_option));
    }
    if (source_.SkipByteOrderMark()) options_.Warn("a byte order mark before the first line ignored");
    MeshLayout layout;
    if (options_.materials != nullptr) {
      layout.labels = MeshLabels::kOfFaces;
      layout.label_property = "usemtl";
      label_ = -1;
    }
    TESSERA_RETURN_IF_ERROR(sink_.Begin(layout));
    while (NextLine()) {
      const std::string_view keyword = TakeWord(rest_);
      if (keyword.empty() || keyword[0] == '#') continue;
      if (keyword == "v") {
        TESSERA_RETURN_IF_ERROR(ReadVertex());
      } else if (keyword == "f" || keyword == "fo") {  // fo: an old name
        TESSERA_RETURN_IF_ERROR(ReadFace());
      } else if (keyword == "usemtl" && options_.materials != nullptr) {
        while (!rest_.empty() && IsBlank(rest_.back())) rest_.remove_suffix(1);
        label_ = rest_.empty() ? -1 : options_.materials->IndexOf(rest_);  // a name may contain blanks
      } else if (!IsSkippedStatement(keyword)) {
        return Error(Quoted(keyword), "a statement of a polygon mesh: v, vt, vn, f, o, g, s, usemtl or mtllib");
      }
    }
    TESSERA_RETURN_IF_ERROR(source_.status());
    if (!source_.AtEnd()) {
      ++line_;
      return Error(absl::StrCat("a line of more than ", kMaxLineBytes, " bytes"), "a shorter line");
    }
    if (largest_index_ >= vertices_) {
      line_ = largest_index_line_;
      return Error(absl::StrCat("vertex index ", largest_index_ + 1), ExpectedIndex());
    }
    fan_.Warn("line", options_);
    return absl::OkStatus();
  }

 private:
  // Sets rest_ to the next line, without the blanks before its first word.
  bool NextLine() {
    if (!source_.NextLine(rest_, kMaxLineBytes)) return false;
    ++line_;
    SkipBlanks(rest_);
    return true;
  }

  // The next word of the statement, which a backslash continues on the next line. Empty at its end.
  std::string_view Word() {
    std::string_view word = TakeWord(rest_);
    while (word == "\\" && rest_.empty() && NextLine()) word = TakeWord(rest_);
    if (!word.empty() && word[0] == '#') {
      rest_ = {};
      return {};
    }
    return word;
  }

  Status ReadVertex() {
    if (vertices_ == kMaxObjVertices) return Error("one vertex more", absl::StrCat("at most ", kMaxObjVertices));
    Eigen::Vector3d position;
    for (int k = 0; k < 3; ++k) {
      const std::string_view word = Word();
      if (word.empty()) return Error(absl::StrCat("a vertex of ", k, " coordinates"), "3 coordinates");
      if (!ParseNumber(word, position[k]) || !std::isfinite(position[k])) {
        return Error(absl::StrCat("coordinate ", Quoted(word)), "a finite number");
      }
    }
    // A weight or a colour may follow.
    while (!Word().empty()) {
    }
    ++vertices_;
    sink_.AddVertex(position, 0);
    return absl::OkStatus();
  }

  Status ReadFace() {
    const int64_t line = line_;
    face_.clear();
    for (std::string_view word = Word(); !word.empty(); word = Word()) {
      int64_t index = 0;
      if (!ParseInteger(word.substr(0, word.find('/')), index) ||
          word.find_first_not_of("0123456789+-/") != std::string_view::npos) {
        return Error(absl::StrCat("face vertex ", Quoted(word)), "an index, as in '7', '7/1', '7//2' or '-1'");
      }
      // Indices count from 1; negative ones count back from the last vertex.
      const int64_t vertex = index < 0 ? vertices_ + index : index - 1;
      if (index == 0 || vertex < 0 || vertex >= kMaxObjVertices) {
        return Error(absl::StrCat("vertex index ", index), ExpectedIndex());
      }
      if (static_cast<int64_t>(face_.size()) == kMaxFaceVertices) {
        return Error(absl::StrCat("a face of more than ", kMaxFaceVertices, " vertices"), ExpectedVertexCount());
      }
      if (vertex > largest_index_) {
        largest_index_ = vertex;
        largest_index_line_ = line_;
      }
      face_.push_back(static_cast<uint32_t>(vertex));
    }
    if (face_.size() < 3) return Error(absl::StrCat("a face of ", face_.size(), " vertices"), ExpectedVertexCount());
    fan_.AddFace(face_, label_, line);
    return absl::OkStatus();
  }

  std::string ExpectedIndex() const {
    return absl::StrCat("1 to ", vertices_, ", or -1 to -", vertices_, " from the last vertex");
  }

  Status Error(const std::string& found, const std::string& expected) const {
    if (!source_.status().ok()) return source_.status();
    return InputError(name_, absl::StrCat("line ", line_), found, expected);
  }

  ByteSource& source_;
  const std::string& name_;
  const MeshReadOptions& options_;
  MeshSink& sink_;
  PolygonFan fan_;
  std::string_view rest_;       // of the line
  int64_t line_ = 0;            // lines read
  int64_t vertices_ = 0;        // vertices read
  std::vector<uint32_t> face_;  // vertices of the face
  int32_t label_ = 0;           // of the current material, if asked for
  // A face may precede its vertices.
  int64_t largest_index_ = -1, largest_index_line_ = 0;
};

}  // namespace

bool IsObj(std::string_view head) {
  bool has_comments = false;
  while (!head.empty()) {
    const size_t end = head.find('\n');
    if (end == std::string_view::npos && has_comments) break;  // the last line may be cut
    std::string_view line = head.substr(0, end);
    head.remove_prefix(end == std::string_view::npos ? head.size() : end + 1);
    if (line.starts_with("\xef\xbb\xbf")) line.remove_prefix(3);
    SkipBlanks(line);
    const std::string_view keyword = TakeWord(line);
    if (keyword.empty()) continue;
    if (keyword[0] != '#') return keyword == "v" || keyword == "f" || IsSkippedStatement(keyword);
    has_comments = true;
  }
  return has_comments;
}

bool ObjHasLabels(std::string_view, const std::optional<std::string>&) { return false; }

StatusOr<MeshContent> ReadObj(const std::string& path, const MeshReadOptions& options) {
  return CollectMesh(path, options, [&](MeshSink& sink) { return StreamObj(path, options, &sink); });
}

Status StreamObj(const std::string& path, const MeshReadOptions& options, MeshSink* sink) {
  TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<ByteSource> source, ByteSource::Open(path));
  return ObjReader(*source, path, options, *sink).Read();
}

StatusOr<bool> ObjHasMoreFaces(const std::string& path, int64_t max_faces) {
  TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<ByteSource> source, ByteSource::Open(path));
  if (source->size_bytes() / kLeastTriangleBytes <= max_faces) return false;
  TESSERA_ASSIGN_OR_RETURN(const int64_t faces,
                           CountTriangles([&](MeshSink& sink) { return StreamObj(path, MeshReadOptions(), &sink); }));
  return faces > max_faces;
}

StatusOr<MeshContent> ParseObj(const std::string& bytes, const std::string& name, const MeshReadOptions& options) {
  return CollectMesh(name, options, [&](MeshSink& sink) {
    const std::unique_ptr<ByteSource> source = ByteSource::FromMemory(bytes);
    return ObjReader(*source, name, options, sink).Read();
  });
}

}  // namespace tessera
