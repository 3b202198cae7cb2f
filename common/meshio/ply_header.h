// The header of a PLY file.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/meshio/byte_source.h"
#include "common/meshio/mesh_content.h"

namespace tessera {

enum class PlyFormat { kAscii, kBinaryLittleEndian, kBinaryBigEndian };
enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };
// The role of a property in the mesh; kOther is skipped.
enum class PlyRole { kOther, kX, kY, kZ, kIndices, kLabel, kConfidence };

int PlyTypeBytes(PlyType type);
bool IsInteger(PlyType type);

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::kFloat32;  // for lists: type of the items
  bool is_list = false;
  PlyType count_type = PlyType::kUint8;  // lists only
  PlyRole role = PlyRole::kOther;
  int64_t line = 0;  // line of its declaration
};

enum class PlyElementKind { kOther, kVertex, kFace };

struct PlyElement {
  std::string name;
  PlyElementKind kind = PlyElementKind::kOther;
  int64_t count = 0;
  int64_t line = 0;  // line of its declaration
  std::vector<PlyProperty> properties;
};

struct PlyHeader {
  PlyFormat format = PlyFormat::kAscii;
  std::vector<PlyElement> elements;
  int64_t lines = 0;  // number of header lines
  int64_t vertex_count = 0, face_count = 0;
  bool has_byte_order_mark = false;
  bool float_positions = false;
  MeshLabels labels = MeshLabels::kNone;
  std::string label_property;  // empty without labels
  int64_t label_line = 0;      // line of its declaration
};

// Consumes the header from `source` and checks it: the mesh's properties exist once with valid types, and the rest of
// the source is large enough for the declared counts. INVALID_ARGUMENT with `name` (the file's name) and the line.
StatusOr<PlyHeader> ReadPlyHeader(ByteSource& source, const std::string& name, const MeshReadOptions& options);

// Whether the header that begins with `head` declares labels, or properties that leave open which are the labels.
// `label_property`: as in MeshReadOptions.
bool DeclaresPlyLabels(const std::string& head, const std::optional<std::string>& label_property);

// The minimum size of one element in the file.
int64_t LeastElementBytes(const PlyElement& element, PlyFormat format);

}  // namespace tessera
