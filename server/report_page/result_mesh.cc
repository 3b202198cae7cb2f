#include "server/report_page/result_mesh.h"

#include <algorithm>
#include <cstring>

#include "absl/strings/str_cat.h"
#include "common/meshio/ply_header.h"

namespace tessera {
namespace {

template <class T>
T Load(const char* at) {
  T value;
  std::memcpy(&value, at, sizeof(T));
  return value;
}

Status NoResultMesh(const std::string& path) {
  return InputError(path, "", "a PLY of another layout", "mesh.ply of a job");
}

}  // namespace

StatusOr<ResultMesh> ResultMesh::Open(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const auto source, ByteSource::Open(path));
  TESSERA_ASSIGN_OR_RETURN(const PlyHeader header, ReadPlyHeader(*source, path, MeshReadOptions()));
  ResultMesh mesh;
  if (header.format != PlyFormat::kBinaryLittleEndian || header.elements.size() != 2 ||
      header.elements[0].kind != PlyElementKind::kVertex || header.elements[1].kind != PlyElementKind::kFace) {
    return NoResultMesh(path);
  }
  for (const PlyProperty& property : header.elements[0].properties) {
    if (property.is_list) return NoResultMesh(path);
    if (property.role == PlyRole::kX || property.role == PlyRole::kY || property.role == PlyRole::kZ) {
      if (property.type != PlyType::kFloat64) return NoResultMesh(path);
      mesh.position_at_[static_cast<size_t>(property.role) - static_cast<size_t>(PlyRole::kX)] = mesh.vertex_bytes_;
    }
    mesh.vertex_bytes_ += static_cast<size_t>(PlyTypeBytes(property.type));
  }
  for (const PlyProperty& property : header.elements[1].properties) {
    const size_t at = mesh.face_bytes_;
    if (property.is_list) {
      if (property.role != PlyRole::kIndices || property.count_type != PlyType::kUint8 ||
          PlyTypeBytes(property.type) != sizeof(uint32_t)) {
        return NoResultMesh(path);
      }
      mesh.corners_at_ = at;
      mesh.face_bytes_ += 1 + sizeof(Triangle);
      continue;
    }
    const auto take = [&](const char* name, PlyType type, size_t* to) {
      if (property.name == name && property.type == type) *to = at;
    };
    take("label", PlyType::kInt32, &mesh.label_at_);
    take("red", PlyType::kUint8, &mesh.color_at_);  // green and blue follow
    take("confidence", PlyType::kFloat32, &mesh.confidence_at_);
    take("input_face", PlyType::kInt32, &mesh.input_face_at_);
    mesh.face_bytes_ += static_cast<size_t>(PlyTypeBytes(property.type));
  }
  if (mesh.color_at_ != kNone && mesh.color_at_ + 3 > mesh.face_bytes_) mesh.color_at_ = kNone;
  mesh.vertices_ = static_cast<size_t>(header.vertex_count);
  mesh.faces_ = static_cast<size_t>(header.face_count);
  mesh.vertices_at_ = static_cast<size_t>(source->offset_bytes());
  mesh.faces_at_ = mesh.vertices_at_ + mesh.vertices_ * mesh.vertex_bytes_;
  TESSERA_ASSIGN_OR_RETURN(mesh.file_, MappedFile::Open(path));
  if (mesh.faces_ > (mesh.file_.size_bytes() - std::min(mesh.faces_at_, mesh.file_.size_bytes())) / mesh.face_bytes_) {
    return NoResultMesh(path);
  }
  return mesh;
}

Eigen::Vector3d ResultMesh::Vertex(size_t vertex) const {
  const char* const at = file_.data() + vertices_at_ + vertex * vertex_bytes_;
  return {Load<double>(at + position_at_[0]), Load<double>(at + position_at_[1]), Load<double>(at + position_at_[2])};
}

StatusOr<ResultFace> ResultMesh::Face(size_t face) const {
  const char* const at = file_.data() + faces_at_ + face * face_bytes_;
  ResultFace found;
  found.corners = Load<Triangle>(at + corners_at_ + 1);
  const bool exist = std::all_of(found.corners.begin(), found.corners.end(), [&](uint32_t v) { return v < vertices_; });
  if (at[corners_at_] != 3 || !exist) return absl::DataLossError(absl::StrCat("mesh.ply: face ", face, " is damaged"));
  if (label_at_ != kNone) found.label = Load<int32_t>(at + label_at_);
  if (color_at_ != kNone) found.color_rgb = Load<std::array<uint8_t, 3>>(at + color_at_);
  if (confidence_at_ != kNone) found.confidence = Load<float>(at + confidence_at_);
  if (input_face_at_ != kNone) found.input_face = Load<int32_t>(at + input_face_at_);
  return found;
}

}  // namespace tessera
