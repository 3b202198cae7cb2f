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

Status Stream(ByteSource& source, const PlyHeader& header, const std::string& name, MeshSink& sink) {
  TESSERA_RETURN_IF_ERROR(sink.Begin(header.vertex_count, header.face_count, header.has_label, header.float_positions));
  return header.format == PlyFormat::kAscii ? ReadPlyText(source, header, name, sink)
                                            : ReadPlyBinary(source, header, name, sink);
}

class ContentSink : public MeshSink {
 public:
  explicit ContentSink(MeshContent& content) : content_(content) {}
  Status Begin(int64_t, int64_t, bool has_labels, bool float_positions) override {
    has_labels_ = has_labels;
    content_.float_positions = float_positions;
    return absl::OkStatus();
  }
  void AddVertex(const Eigen::Vector3d& position) override { content_.mesh.vertices.push_back(position); }
  void AddFace(const Triangle& vertices, int32_t label) override {
    content_.mesh.faces.push_back(vertices);
    if (has_labels_) content_.mesh.labels.push_back(label);
  }

 private:
  MeshContent& content_;
  bool has_labels_ = false;
};

// Reserves memory for the declared vertices and faces, limited by the size of `source`.
void ReserveMesh(const ByteSource& source, const PlyHeader& header, TriangleMesh& mesh) {
  const int64_t available = source.size_bytes() - source.offset_bytes();
  for (const PlyElement& element : header.elements) {
    int64_t least = LeastElementBytes(element, header.format);
    if (element.kind == PlyElementKind::kFace) {
      // Add the three indices that follow the list's count.
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

StatusOr<MeshContent> Parse(ByteSource& source, const std::string& name) {
  TESSERA_ASSIGN_OR_RETURN(const PlyHeader header, ReadPlyHeader(source, name));
  MeshContent content;
  try {
    ReserveMesh(source, header, content.mesh);
    ContentSink sink(content);
    TESSERA_RETURN_IF_ERROR(Stream(source, header, name, sink));
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat(name, ": not enough memory for the mesh"));
  }
  return content;
}

}  // namespace

bool IsPly(std::string_view head) { return head.starts_with("ply\n") || head.starts_with("ply\r\n"); }

bool PlyHasLabels(std::string_view head) {
  const std::string_view header = head.substr(0, head.find("end_header"));
  const size_t faces = header.find("element face");
  if (faces == std::string_view::npos) return false;
  const std::string_view properties = header.substr(faces, header.find("\nelement", faces) - faces);
  for (size_t at = properties.find(" label"); at != std::string_view::npos; at = properties.find(" label", at + 1)) {
    const char after = at + 6 < properties.size() ? properties[at + 6] : '\n';
    if (after == '\n' || after == '\r' || after == ' ') return true;
  }
  return false;
}

StatusOr<MeshContent> ReadPly(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<ByteSource> source, ByteSource::Open(path));
  return Parse(*source, path);
}

Status StreamPly(const std::string& path, MeshSink* sink) {
  TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<ByteSource> source, ByteSource::Open(path));
  TESSERA_ASSIGN_OR_RETURN(const PlyHeader header, ReadPlyHeader(*source, path));
  return Stream(*source, header, path, *sink);
}

StatusOr<int64_t> PlyFaceCount(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<ByteSource> source, ByteSource::Open(path));
  TESSERA_ASSIGN_OR_RETURN(const PlyHeader header, ReadPlyHeader(*source, path));
  return header.face_count;
}

StatusOr<MeshContent> ParsePly(const std::string& bytes, const std::string& name) {
  return Parse(*ByteSource::FromMemory(bytes), name);
}

}  // namespace tessera
