// The header of a PLY file.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/meshio/byte_source.h"

namespace tessera {

enum class PlyFormat { kAscii, kBinaryLittleEndian, kBinaryBigEndian };
enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };
// The role of a property in the mesh; kOther is skipped.
enum class PlyRole { kOther, kX, kY, kZ, kIndices, kLabel };

int PlyTypeBytes(PlyType type);
bool IsInteger(PlyType type);

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::kFloat32;  // for lists: type of the items
  bool is_list = false;
  PlyType count_type = PlyType::kUint8;  // lists only
  PlyRole role = PlyRole::kOther;
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
  bool has_label = false;
  bool float_positions = false;
};

// Consumes the header from `source` and checks it: the mesh's properties exist once with valid types, and the rest of
// the source is large enough for the declared counts. INVALID_ARGUMENT with `name` (the file's name) and the line.
StatusOr<PlyHeader> ReadPlyHeader(ByteSource& source, const std::string& name);

// The minimum size of one element in the file.
int64_t LeastElementBytes(const PlyElement& element, PlyFormat format);

// `text` for messages: in quotes, cut at 40 characters, unprintable characters escaped.
std::string Quoted(std::string_view text);

}  // namespace tessera
