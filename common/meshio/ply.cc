#include "common/meshio/ply.h"

#include <algorithm>
#include <memory>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/meshio/byte_source.h"
#include "common/meshio/ply_body.h"
#include "common/meshio/ply_header.h"

namespace tessera {
namespace {

constexpr int64_t kTextIndexBytes = 2;  // a digit and a separator

bool HasConfidence(const PlyHeader& header) {
  for (const PlyElement& element : header.elements) {
    for (const PlyProperty& property : element.properties) {
      if (property.role == PlyRole::kConfidence) return true;
    }
  }
  return false;
}

void FindConfidence(PlyHeader* header) {
  for (PlyElement& element : header->elements) {
    if (element.kind != PlyElementKind::kFace) continue;
    for (PlyProperty& property : element.properties) {
      if (property.name == "confidence" && !property.is_list && property.role == PlyRole::kOther) {
        property.role = PlyRole::kConfidence;
      }
    }
  }
}

// The layout with counts bounded by the size of `source`, which is positioned after the header.
MeshLayout LayoutOf(const ByteSource& source, const PlyHeader& header) {
  MeshLayout layout;
  layout.labels = header.labels;
  layout.label_property = header.label_property;
  layout.float_positions = header.float_positions;
  layout.has_confidence = HasConfidence(header);
  const int64_t available = source.size_bytes() - source.offset_bytes();
  for (const PlyElement& element : header.elements) {
    int64_t least = LeastElementBytes(element, header.format);
    if (element.kind == PlyElementKind::kFace) {
      // Add the three indices that follow the list's count.
      for (const PlyProperty& property : element.properties) {
        if (property.role != PlyRole::kIndices) continue;
        least += 3 * (header.format == PlyFormat::kAscii ? kTextIndexBytes : PlyTypeBytes(property.type));
      }
    }
    const int64_t room = std::min(element.count, available / std::max<int64_t>(least, 1) + 1);
    if (element.kind == PlyElementKind::kVertex) layout.vertices = room;
    if (element.kind == PlyElementKind::kFace) layout.faces = room;
  }
  return layout;
}

void WarnOfHeader(const PlyHeader& header, const MeshReadOptions& options) {
  if (header.has_byte_order_mark) options.Warn("a byte order mark before the header ignored");
  if (header.labels == MeshLabels::kOfFaces && !options.label_property && header.label_property != "label") {
    options.Warn(absl::StrCat("labels are those of face property '", Printable(header.label_property), "' (line ",
                              header.label_line, ")"));
  }
}

Status Stream(ByteSource& source, const std::string& name, const MeshReadOptions& options, MeshSink& sink) {
  if (options.materials != nullptr) {
    return InputError(name, "", "a PLY file, which has no materials",
                      "labels of one of its properties, or an OBJ or glTF file with materials");
  }
  TESSERA_ASSIGN_OR_RETURN(PlyHeader header, ReadPlyHeader(source, name, options));
  if (options.confidence) FindConfidence(&header);
  WarnOfHeader(header, options);
  TESSERA_RETURN_IF_ERROR(sink.Begin(LayoutOf(source, header)));
  return header.format == PlyFormat::kAscii ? ReadPlyText(source, header, name, options, sink)
                                            : ReadPlyBinary(source, header, name, options, sink);
}

// Whether the size of the rest of the file shows that all faces are triangles, if the file has no errors.
bool AreAllTriangles(const PlyHeader& header, int64_t available) {
  if (header.format == PlyFormat::kAscii) return false;
  int64_t expected = 0;  // cannot overflow, because the header's counts were checked against the file's size
  for (const PlyElement& element : header.elements) {
    expected += element.count * LeastElementBytes(element, header.format);
    for (const PlyProperty& property : element.properties) {
      if (!property.is_list) continue;
      if (property.role != PlyRole::kIndices) return false;
      expected += element.count * 3 * PlyTypeBytes(property.type);
    }
  }
  return expected == available;
}

int64_t IndexBytes(const PlyHeader& header) {
  if (header.format == PlyFormat::kAscii) return kTextIndexBytes;
  for (const PlyElement& element : header.elements) {
    for (const PlyProperty& property : element.properties) {
      if (property.role == PlyRole::kIndices) return PlyTypeBytes(property.type);
    }
  }
  return 1;
}

}  // namespace

bool IsPly(std::string_view head) {
  constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
  if (head.starts_with(kByteOrderMark)) head.remove_prefix(kByteOrderMark.size());
  return head.starts_with("ply\n") || head.starts_with("ply\r\n");
}

bool PlyHasLabels(std::string_view head, const std::optional<std::string>& label_property) {
  return DeclaresPlyLabels(std::string(head), label_property);
}

StatusOr<MeshContent> ReadPly(const std::string& path, const MeshReadOptions& options) {
  return CollectMesh(path, options, [&](MeshSink& sink) { return StreamPly(path, options, &sink); });
}

Status StreamPly(const std::string& path, const MeshReadOptions& options, MeshSink* sink) {
  TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<ByteSource> source, ByteSource::Open(path));
  return Stream(*source, path, options, *sink);
}

StatusOr<bool> PlyHasMoreFaces(const std::string& path, int64_t max_faces) {
  TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<ByteSource> source, ByteSource::Open(path));
  MeshReadOptions without_labels;
  without_labels.label_property = "";
  TESSERA_ASSIGN_OR_RETURN(const PlyHeader header, ReadPlyHeader(*source, path, without_labels));
  if (header.face_count > max_faces) return true;
  const int64_t available = source->size_bytes() - source->offset_bytes();
  // Each triangle of a fan needs at least one index.
  if (available / IndexBytes(header) <= max_faces || AreAllTriangles(header, available)) return false;
  TESSERA_ASSIGN_OR_RETURN(const int64_t faces,
                           CountTriangles([&](MeshSink& sink) { return StreamPly(path, without_labels, &sink); }));
  return faces > max_faces;
}

StatusOr<MeshContent> ParsePly(const std::string& bytes, const std::string& name, const MeshReadOptions& options) {
  return CollectMesh(name, options,
                     [&](MeshSink& sink) { return Stream(*ByteSource::FromMemory(bytes), name, options, sink); });
}

}  // namespace tessera
