#include "common/meshio/ply.h"

#include <algorithm>
#include <memory>
#include <new>

#include "absl/strings/str_cat.h"
#include "common/meshio/byte_source.h"
#include "common/meshio/ply_body.h"
#include "common/meshio/ply_header.h"

namespace tessera {
namespace {

StatusOr<PlyContent> Parse(ByteSource& source, const std::string& name) {
  TESSERA_ASSIGN_OR_RETURN(const PlyHeader header, ReadPlyHeader(source, name));
  PlyContent content;
  content.float_positions = header.float_positions;
  try {
    if (header.format == PlyFormat::kAscii) {
      TESSERA_RETURN_IF_ERROR(ReadPlyText(source, header, name, content.mesh));
    } else {
      TESSERA_RETURN_IF_ERROR(ReadPlyBinary(source, header, name, content.mesh));
    }
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat(name, ": not enough memory for the mesh"));
  }
  return content;
}

}  // namespace

void ReserveMesh(const ByteSource& source, const PlyHeader& header, TriangleMesh& mesh) {
  const int64_t available = source.size_bytes() - source.offset_bytes();
  for (const PlyElement& element : header.elements) {
    int64_t least = LeastElementBytes(element, header.format);
    if (element.kind == PlyElementKind::kFace) {
      // Three indices more than the list's count.
      for (const PlyProperty& property : element.properties) {
        if (property.role != PlyRole::kIndices) continue;
        least += 3 * (header.format == PlyFormat::kAscii ? 2 : PlyTypeBytes(property.type));
      }
    }
    const auto room = static_cast<size_t>(std::min(element.count, available / std::max<int64_t>(least, 1) + 1));
    if (element.kind == PlyElementKind::kVertex) mesh.vertices.reserve(room);
    if (element.kind == PlyElementKind::kFace) {
      mesh.faces.reserve(room);
      if (header.has_label) mesh.labels.reserve(room);
    }
  }
}

StatusOr<PlyContent> ReadPly(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<ByteSource> source, ByteSource::Open(path));
  return Parse(*source, path);
}

StatusOr<PlyContent> ParsePly(const std::string& bytes, const std::string& name) {
  return Parse(*ByteSource::FromMemory(bytes), name);
}

}  // namespace tessera
