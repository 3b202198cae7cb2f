#include "common/meshio/ply_header.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdio>
#include <limits>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/meshio/ply_labels.h"
#include "common/meshio/text_words.h"

namespace tessera {
namespace {

constexpr size_t kMaxHeaderLineBytes = 64 << 10;
constexpr int64_t kMaxHeaderLines = 100000;
constexpr size_t kMaxNameBytes = 100;  // of elements and properties, because messages quote them

constexpr std::array<std::pair<std::string_view, PlyType>, 16> kTypes = {{{"char", PlyType::kInt8},
                                                                          {"int8", PlyType::kInt8},
                                                                          {"uchar", PlyType::kUint8},
                                                                          {"uint8", PlyType::kUint8},
                                                                          {"short", PlyType::kInt16},
                                                                          {"int16", PlyType::kInt16},
                                                                          {"ushort", PlyType::kUint16},
                                                                          {"uint16", PlyType::kUint16},
                                                                          {"int", PlyType::kInt32},
                                                                          {"int32", PlyType::kInt32},
                                                                          {"uint", PlyType::kUint32},
                                                                          {"uint32", PlyType::kUint32},
                                                                          {"float", PlyType::kFloat32},
                                                                          {"float32", PlyType::kFloat32},
                                                                          {"double", PlyType::kFloat64},
                                                                          {"float64", PlyType::kFloat64}}};

std::vector<std::string_view> Words(std::string_view line) {
  std::vector<std::string_view> words;
  size_t at = 0;
  while (true) {
    at = line.find_first_not_of(" \t", at);
    if (at == std::string_view::npos) return words;
    const size_t end = std::min(line.find_first_of(" \t", at), line.size());
    words.push_back(line.substr(at, end - at));
    at = end;
  }
}

bool FindType(std::string_view word, PlyType& type) {
  for (const auto& [name, value] : kTypes) {
    if (name == word) {
      type = value;
      return true;
    }
  }
  return false;
}

class HeaderParser {
 public:
  HeaderParser(ByteSource& source, const std::string& name) : source_(source), name_(name) {}

  StatusOr<PlyHeader> Parse(const MeshReadOptions& options) {
    TESSERA_RETURN_IF_ERROR(ReadLines());
    TESSERA_RETURN_IF_ERROR(FindMesh());
    TESSERA_RETURN_IF_ERROR(ChoosePlyLabels(name_, options, &header_));
    TESSERA_RETURN_IF_ERROR(CheckCounts());
    return std::move(header_);
  }

  // The declarations before the first error.
  PlyHeader ParsePart() {
    ReadLines().IgnoreError();
    return std::move(header_);
  }

 private:
  Status ReadLines() {
    header_.has_byte_order_mark = source_.SkipByteOrderMark();
    std::string_view line;
    if (!NextLine(line) || line != "ply") return Error(lines_ == 0 ? EndOrQuoted(line) : Quoted(line), "'ply'");
    bool ended = false;
    while (!ended) {
      if (lines_ >= kMaxHeaderLines) return Error(absl::StrCat(kMaxHeaderLines, " header lines"), "'end_header'");
      if (!NextLine(line)) return Error(EndOrQuoted({}), "'end_header'");
      const std::vector<std::string_view> words = Words(line);
      if (words.empty()) return Error("an empty line", "a header line");
      const std::string_view keyword = words[0];
      if (keyword == "comment" || keyword == "obj_info") continue;
      if (keyword == "format") {
        TESSERA_RETURN_IF_ERROR(Format(words));
      } else if (!has_format_) {
        return Error(Quoted(line), "the line 'format ...'");
      } else if (keyword == "element") {
        TESSERA_RETURN_IF_ERROR(Element(words));
      } else if (keyword == "property") {
        TESSERA_RETURN_IF_ERROR(Property(words));
      } else if (keyword == "end_header") {
        if (words.size() != 1) return Error(Quoted(line), "'end_header' without other words");
        ended = true;
      } else {
        return Error(Quoted(keyword), "format, comment, obj_info, element, property or end_header");
      }
    }
    header_.lines = lines_;
    return absl::OkStatus();
  }

  bool NextLine(std::string_view& line) {
    if (!source_.NextLine(line, kMaxHeaderLineBytes)) return false;
    ++lines_;
    return true;
  }

  std::string EndOrQuoted(std::string_view line) {
    if (!line.empty()) return Quoted(line);
    ++lines_;  // the missing line
    return source_.AtEnd() ? "the end of the file" : "a line too long for a header";
  }

  Status Error(const std::string& found, const std::string& expected) const {
    return ErrorAt(std::max<int64_t>(lines_, 1), found, expected);
  }
  Status ErrorAt(int64_t line, const std::string& found, const std::string& expected) const {
    if (!source_.status().ok()) return source_.status();
    return InputError(name_, absl::StrCat("line ", line), found, expected);
  }

  Status CheckName(std::string_view name) const {
    if (name.size() <= kMaxNameBytes) return absl::OkStatus();
    return Error(absl::StrCat("a name of ", name.size(), " bytes: ", Quoted(name)),
                 absl::StrCat("at most ", kMaxNameBytes, " bytes"));
  }

  Status Format(const std::vector<std::string_view>& words) {
    if (has_format_) return Error("a second format line", "one");
    if (words.size() != 3) return Error(absl::StrCat("a format of ", words.size(), " words"), "'format NAME 1.0'");
    if (words[1] == "ascii") {
      header_.format = PlyFormat::kAscii;
    } else if (words[1] == "binary_little_endian") {
      header_.format = PlyFormat::kBinaryLittleEndian;
    } else if (words[1] == "binary_big_endian") {
      header_.format = PlyFormat::kBinaryBigEndian;
    } else {
      return Error(absl::StrCat("format ", Quoted(words[1])), "ascii, binary_little_endian or binary_big_endian");
    }
    if (words[2] != "1.0") return Error(absl::StrCat("version ", Quoted(words[2])), "1.0");
    if (header_.has_byte_order_mark && header_.format != PlyFormat::kAscii) {
      return Error("a byte order mark before a binary PLY",
                   "none: a text editor has saved the file, which damages it; export it again");
    }
    has_format_ = true;
    return absl::OkStatus();
  }

  Status Element(const std::vector<std::string_view>& words) {
    if (words.size() != 3) return Error(absl::StrCat("an element of ", words.size(), " words"), "'element NAME COUNT'");
    PlyElement element;
    TESSERA_RETURN_IF_ERROR(CheckName(words[1]));
    element.name = std::string(words[1]);
    element.line = lines_;
    const char* end = words[2].data() + words[2].size();
    const auto [stop, error] = std::from_chars(words[2].data(), end, element.count);
    if (error != std::errc() || stop != end || element.count < 0) {
      return Error(absl::StrCat("count ", Quoted(words[2])), "an integer of at least 0");
    }
    for (const PlyElement& other : header_.elements) {
      if (other.name == element.name) {
        return Error(absl::StrCat("a second element ", Quoted(element.name)), "each element once");
      }
    }
    if (element.name == "vertex") {
      element.kind = PlyElementKind::kVertex;
      if (element.count > std::numeric_limits<uint32_t>::max()) {
        return Error(absl::StrCat(element.count, " vertices"), "at most 4294967295");
      }
      header_.vertex_count = element.count;
    } else if (element.name == "face") {
      element.kind = PlyElementKind::kFace;
      header_.face_count = element.count;
    }
    header_.elements.push_back(std::move(element));
    return absl::OkStatus();
  }

  Status Property(const std::vector<std::string_view>& words) {
    if (header_.elements.empty()) return Error("a property before any element", "'element ...'");
    PlyProperty property;
    property.is_list = words.size() > 1 && words[1] == "list";
    const size_t type_at = property.is_list ? 3 : 1;
    if (words.size() != type_at + 2) {
      return Error(absl::StrCat("a property of ", words.size(), " words"),
                   "'property TYPE NAME' or 'property list COUNT_TYPE TYPE NAME'");
    }
    if (!FindType(words[type_at], property.type)) {
      return Error(absl::StrCat("type ", Quoted(words[type_at])), "a PLY type such as int, uchar, float or double");
    }
    if (property.is_list && (!FindType(words[2], property.count_type) || !IsInteger(property.count_type))) {
      return Error(absl::StrCat("list count type ", Quoted(words[2])), "an integer type");
    }
    TESSERA_RETURN_IF_ERROR(CheckName(words[type_at + 1]));
    property.name = std::string(words[type_at + 1]);
    property.line = lines_;
    PlyElement& element = header_.elements.back();
    for (const PlyProperty& other : element.properties) {
      if (other.name == property.name) {
        return Error(absl::StrCat("a second property ", Quoted(property.name), " of element ", Quoted(element.name)),
                     "each property once");
      }
    }
    TESSERA_RETURN_IF_ERROR(AssignRole(element, property));
    element.properties.push_back(std::move(property));
    return absl::OkStatus();
  }

  Status AssignRole(const PlyElement& element, PlyProperty& property) {
    const std::string& name = property.name;
    if (element.kind == PlyElementKind::kVertex && (name == "x" || name == "y" || name == "z")) {
      if (property.is_list) return Error(absl::StrCat("a list ", Quoted(name)), "a number");
      property.role = name == "x" ? PlyRole::kX : name == "y" ? PlyRole::kY : PlyRole::kZ;
      header_.float_positions = header_.float_positions || property.type == PlyType::kFloat32;
    }
    if (element.kind != PlyElementKind::kFace) return absl::OkStatus();
    if (name == "vertex_indices" || name == "vertex_index") {
      if (!property.is_list || !IsInteger(property.type)) {
        return Error(absl::StrCat("face property ", Quoted(name), " that is not a list of integers"),
                     absl::StrCat("'property list uchar int ", name, "'"));
      }
      for (const PlyProperty& other : element.properties) {
        if (other.role == PlyRole::kIndices) {
          return Error("both vertex_indices and vertex_index", "one of them");
        }
      }
      property.role = PlyRole::kIndices;
    }
    return absl::OkStatus();
  }

  Status FindMesh() const {
    const PlyElement* vertex = nullptr;
    const PlyElement* face = nullptr;
    for (const PlyElement& element : header_.elements) {
      if (element.kind == PlyElementKind::kVertex) vertex = &element;
      if (element.kind == PlyElementKind::kFace) face = &element;
    }
    if (vertex == nullptr) return Error("no element 'vertex'", "'element vertex COUNT'");
    if (face == nullptr) return Error("no element 'face'", "'element face COUNT': build a mesh from a point cloud");
    const auto has = [](const PlyElement& element, PlyRole role) {
      return std::any_of(element.properties.begin(), element.properties.end(),
                         [&](const PlyProperty& property) { return property.role == role; });
    };
    for (const auto& [role, name] : {std::pair{PlyRole::kX, "x"}, {PlyRole::kY, "y"}, {PlyRole::kZ, "z"}}) {
      if (!has(*vertex, role)) {
        return ErrorAt(vertex->line, absl::StrCat("vertices without property '", name, "'"), "x, y and z");
      }
    }
    if (!has(*face, PlyRole::kIndices)) {
      return ErrorAt(face->line, "faces without a list 'vertex_indices' or 'vertex_index'",
                     "'property list uchar int vertex_indices'");
    }
    return absl::OkStatus();
  }

  // Checks the declared counts against the size of the source before memory is allocated.
  Status CheckCounts() const {
    const int64_t available = std::max<int64_t>(source_.size_bytes() - source_.offset_bytes(), 0);
    // The last line of a text may have no line end.
    __int128 least = header_.format == PlyFormat::kAscii ? -1 : 0;
    for (const PlyElement& element : header_.elements) {
      least += static_cast<__int128>(element.count) * LeastElementBytes(element, header_.format);
      if (least > available) {
        return ErrorAt(element.line,
                       absl::StrCat(element.count, " elements ", Quoted(element.name), " declared, ", available,
                                    " bytes after the header"),
                       absl::StrCat("at least ",
                                    least > std::numeric_limits<int64_t>::max() ? std::numeric_limits<int64_t>::max()
                                                                                : static_cast<int64_t>(least),
                                    " bytes"));
      }
    }
    return absl::OkStatus();
  }

  ByteSource& source_;
  const std::string& name_;
  PlyHeader header_;
  bool has_format_ = false;
  int64_t lines_ = 0;
};

}  // namespace

int PlyTypeBytes(PlyType type) {
  constexpr int kBytes[] = {1, 1, 2, 2, 4, 4, 4, 8};  // in the order of PlyType
  return kBytes[static_cast<int>(type)];
}

bool IsInteger(PlyType type) { return type != PlyType::kFloat32 && type != PlyType::kFloat64; }

int64_t LeastElementBytes(const PlyElement& element, PlyFormat format) {
  int64_t bytes = 0;
  for (const PlyProperty& property : element.properties) {
    // ASCII: one character and a separator.
    bytes += format == PlyFormat::kAscii ? 2 : PlyTypeBytes(property.is_list ? property.count_type : property.type);
  }
  return bytes;
}

StatusOr<PlyHeader> ReadPlyHeader(ByteSource& source, const std::string& name, const MeshReadOptions& options) {
  return HeaderParser(source, name).Parse(options);
}

bool DeclaresPlyLabels(const std::string& head, const std::optional<std::string>& label_property) {
  // The last line may be cut.
  const std::string lines = head.substr(0, head.rfind('\n') + 1), name;
  const std::unique_ptr<ByteSource> source = ByteSource::FromMemory(lines);
  PlyHeader header = HeaderParser(*source, name).ParsePart();
  MeshReadOptions options;
  options.label_property = label_property;
  return !ChoosePlyLabels(name, options, &header).ok() || header.labels != MeshLabels::kNone;
}

}  // namespace tessera
