// The header of a PLY file, and what in it makes the mesh.
#ifndef TESSERA_COMMON_MESHIO_PLY_HEADER_H_
#define TESSERA_COMMON_MESHIO_PLY_HEADER_H_

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/meshio/byte_source.h"

namespace tessera {

enum class PlyFormat { kAscii, kBinaryLittleEndian, kBinaryBigEndian };
enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };
// What a property is to the mesh; kOther is read past.
enum class PlyRole { kOther, kX, kY, kZ, kIndices, kLabel };

int PlyTypeBytes(PlyType type);
bool IsInteger(PlyType type);

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::kFloat32;  // of the items, if it is a list
  bool is_list = false;
  PlyType count_type = PlyType::kUint8;  // lists only
  PlyRole role = PlyRole::kOther;
};

enum class PlyElementKind { kOther, kVertex, kFace };

struct PlyElement {
  std::string name;
  PlyElementKind kind = PlyElementKind::kOther;
  int64_t count = 0;
  int64_t line = 0;  // where it is declared
  std::vector<PlyProperty> properties;
};

struct PlyHeader {
  PlyFormat format = PlyFormat::kAscii;
  std::vector<PlyElement> elements;
  int64_t lines = 0;  // of the header
  int64_t vertex_count = 0;
  bool has_label = false;
  bool float_positions = false;
};

// Consumes the header from `source` and checks all that it can tell: the mesh's properties are there, once, and of
// fitting types, and the rest of the source is large enough for the declared counts. `name` stands for the file in
// messages. INVALID_ARGUMENT with the line.
StatusOr<PlyHeader> ReadPlyHeader(ByteSource& source, const std::string& name);

// The fewest bytes that one element takes in a file.
int64_t LeastElementBytes(const PlyElement& element, PlyFormat format);

// `text` as a message shows it: in quotes, cut at 40 characters, unprintable ones escaped.
std::string Quoted(std::string_view text);

}  // namespace tessera

#endif  // TESSERA_COMMON_MESHIO_PLY_HEADER_H_
