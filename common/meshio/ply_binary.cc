#include <bit>
#include <cmath>
#include <cstring>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/meshio/ply_body.h"
#include "common/meshio/text_words.h"

namespace tessera {
namespace {

static_assert(std::endian::native == std::endian::little);

template <class Value, bool kSwap>
Value Load(const char* bytes) {
  char ordered[sizeof(Value)];
  for (size_t i = 0; i < sizeof(Value); ++i) ordered[i] = bytes[kSwap ? sizeof(Value) - 1 - i : i];
  Value value;
  std::memcpy(&value, ordered, sizeof(Value));
  return value;
}

template <bool kSwap>
int64_t LoadInteger(const char* bytes, PlyType type) {
  switch (type) {
    case PlyType::kInt8:
      return Load<int8_t, kSwap>(bytes);
    case PlyType::kUint8:
      return Load<uint8_t, kSwap>(bytes);
    case PlyType::kInt16:
      return Load<int16_t, kSwap>(bytes);
    case PlyType::kUint16:
      return Load<uint16_t, kSwap>(bytes);
    case PlyType::kInt32:
      return Load<int32_t, kSwap>(bytes);
    case PlyType::kUint32:
      return Load<uint32_t, kSwap>(bytes);
    default:
      return 0;
  }
}

template <bool kSwap>
double LoadNumber(const char* bytes, PlyType type) {
  if (type == PlyType::kFloat64) return Load<double, kSwap>(bytes);
  if (type == PlyType::kFloat32) return Load<float, kSwap>(bytes);
  return static_cast<double>(LoadInteger<kSwap>(bytes, type));
}

// A step of reading an element: one property of the mesh or one list, or a run of properties to skip.
struct Step {
  PlyRole role = PlyRole::kOther;
  bool is_list = false;
  PlyType type = PlyType::kInt8;
  PlyType count_type = PlyType::kInt8;
  size_t bytes = 0;  // size of the value, or of the list's count
  std::string name;
};

std::vector<Step> StepsOf(const PlyElement& element) {
  std::vector<Step> steps;
  for (const PlyProperty& property : element.properties) {
    Step step{property.role, property.is_list, property.type, property.count_type, 0, property.name};
    step.bytes = static_cast<size_t>(PlyTypeBytes(property.is_list ? property.count_type : property.type));
    const bool plain = step.role == PlyRole::kOther && !step.is_list;
    if (plain && !steps.empty() && steps.back().role == PlyRole::kOther && !steps.back().is_list) {
      steps.back().bytes += step.bytes;
    } else {
      steps.push_back(std::move(step));
    }
  }
  return steps;
}

template <bool kSwap>
class BinaryReader {
 public:
  BinaryReader(ByteSource& source, const PlyHeader& header, const std::string& name, const MeshReadOptions& options,
               MeshSink& sink)
      : source_(source), header_(header), name_(name), options_(options), sink_(sink), fan_(sink) {}

  Status Read() {
    for (const PlyElement& element : header_.elements) {
      if (element.properties.empty()) continue;
      const std::vector<Step> steps = StepsOf(element);
      const bool is_other = element.kind == PlyElementKind::kOther;
      if (is_other && steps.size() == 1 && !steps[0].is_list) {
        // Cannot overflow, because the header's counts were checked against the file's size.
        index_ = element.count;
        if (!source_.Skip(steps[0].bytes * static_cast<uint64_t>(element.count))) return Truncated(element);
        continue;
      }
      for (index_ = 0; index_ < element.count; ++index_) TESSERA_RETURN_IF_ERROR(ReadElement(element, steps));
    }
    TESSERA_RETURN_IF_ERROR(CheckPlyEnd(source_, name_, absl::StrCat("byte ", source_.offset_bytes()), options_));
    fan_.Warn("byte", options_);
    return absl::OkStatus();
  }

 private:
  Status ReadElement(const PlyElement& element, const std::vector<Step>& steps) {
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    int32_t label = 0;
    for (const Step& step : steps) {
      const char* bytes = source_.Peek(step.bytes);
      if (bytes == nullptr) return Truncated(element);
      switch (step.role) {
        case PlyRole::kX:
        case PlyRole::kY:
        case PlyRole::kZ: {
          const double value = LoadNumber<kSwap>(bytes, step.type);
          if (!std::isfinite(value)) return Error(element, absl::StrCat(step.name, " = ", value), "a finite number");
          position[static_cast<int>(step.role) - static_cast<int>(PlyRole::kX)] = value;
          source_.Advance(step.bytes);
          break;
        }
        case PlyRole::kLabel: {
          // All integer types of PLY fit a double.
          const double value = LoadNumber<kSwap>(bytes, step.type);
          if (!LabelOf(value, label)) {
            return Error(element, absl::StrFormat("label %.*g", step.type == PlyType::kFloat64 ? 17 : 10, value),
                         ExpectedLabel(header_, options_));
          }
          source_.Advance(step.bytes);
          break;
        }
        case PlyRole::kConfidence:
          sink_.SetConfidence(static_cast<float>(LoadNumber<kSwap>(bytes, step.type)));
          source_.Advance(step.bytes);
          break;
        case PlyRole::kIndices:
          TESSERA_RETURN_IF_ERROR(ReadIndices(element, step));
          break;
        case PlyRole::kOther: {
          const int64_t count = step.is_list ? LoadInteger<kSwap>(bytes, step.count_type) : 0;
          if (count < 0) {
            return Error(element, absl::StrCat("a list ", Quoted(step.name), " of ", count, " values"),
                         "an integer of at least 0");
          }
          source_.Advance(step.bytes);
          if (!source_.Skip(static_cast<uint64_t>(count) * PlyTypeBytes(step.type))) return Truncated(element);
          break;
        }
      }
    }
    if (element.kind == PlyElementKind::kVertex) sink_.AddVertex(position, label);
    if (element.kind == PlyElementKind::kFace) fan_.AddFace(vertices_, label, face_place_);
    return absl::OkStatus();
  }

  // Reads the face's vertices_ and its face_place_.
  Status ReadIndices(const PlyElement& element, const Step& step) {
    const size_t item_bytes = static_cast<size_t>(PlyTypeBytes(step.type));
    const int64_t count = LoadInteger<kSwap>(source_.Peek(step.bytes), step.count_type);
    if (count < 3 || count > kMaxFaceVertices) {
      return Error(element, absl::StrCat("a face of ", count, " vertices"), ExpectedVertexCount());
    }
    const size_t list_bytes = step.bytes + static_cast<size_t>(count) * item_bytes;
    const char* bytes = source_.Peek(list_bytes);
    if (bytes == nullptr) return Truncated(element);
    face_place_ = source_.offset_bytes();
    vertices_.resize(static_cast<size_t>(count));
    bytes += step.bytes;
    for (uint32_t& vertex : vertices_) {
      const int64_t index = LoadInteger<kSwap>(bytes, step.type);
      if (index < 0 || index >= header_.vertex_count) {
        return Error(element, absl::StrCat("vertex index ", index),
                     absl::StrCat("an index below ", header_.vertex_count));
      }
      vertex = static_cast<uint32_t>(index);
      bytes += item_bytes;
    }
    source_.Advance(list_bytes);
    return absl::OkStatus();
  }

  Status Error(const PlyElement& element, const std::string& found, const std::string& expected) const {
    if (!source_.status().ok()) return source_.status();
    return InputError(name_, absl::StrCat("byte ", source_.offset_bytes(), " (", element.name, " ", index_, ")"), found,
                      expected);
  }
  Status Truncated(const PlyElement& element) const {
    return Error(element, absl::StrCat("the end of the file (", source_.size_bytes(), " bytes)"),
                 absl::StrCat(element.count, " elements ", Quoted(element.name)));
  }

  ByteSource& source_;
  const PlyHeader& header_;
  const std::string& name_;
  const MeshReadOptions& options_;
  MeshSink& sink_;
  PolygonFan fan_;
  std::vector<uint32_t> vertices_;  // of the face
  int64_t face_place_ = 0;          // byte offset of the face's list of vertices
  int64_t index_ = 0;
};

}  // namespace

Status ReadPlyBinary(ByteSource& source, const PlyHeader& header, const std::string& name,
                     const MeshReadOptions& options, MeshSink& sink) {
  if (header.format == PlyFormat::kBinaryBigEndian) {
    return BinaryReader<true>(source, header, name, options, sink).Read();
  }
  return BinaryReader<false>(source, header, name, options, sink).Read();
}

}  // namespace tessera
