#include "common/synth/start_mesh/mesh_spool.h"

#include <numeric>
#include <vector>

#include "common/meshio/ply.h"
#include "common/storage/temporary_name.h"

namespace tessera {
namespace {

struct FaceRecord {
  uint32_t vertex[3];
  int32_t label;
};

}  // namespace

MeshSpool::MeshSpool(const std::string& path_prefix)
    : vertex_path_(TemporaryBeside(path_prefix + ".vertices")), face_path_(TemporaryBeside(path_prefix + ".faces")) {
  vertices_ = std::fopen(vertex_path_.c_str(), "w+bx");
  faces_ = std::fopen(face_path_.c_str(), "w+bx");
  failed_ = vertices_ == nullptr || faces_ == nullptr;
}

MeshSpool::~MeshSpool() {
  if (vertices_ != nullptr) std::fclose(vertices_);
  if (faces_ != nullptr) std::fclose(faces_);
  std::remove(vertex_path_.c_str());
  std::remove(face_path_.c_str());
}

void MeshSpool::AddVertex(const Eigen::Vector3d& p) {
  if (failed_) return;
  failed_ = std::fwrite(p.data(), sizeof(double), 3, vertices_) != 3;
  ++vertex_count_;
}

void MeshSpool::AddFace(const Triangle& face, int32_t label) {
  if (failed_) return;
  const FaceRecord record{{face[0], face[1], face[2]}, label};
  failed_ = std::fwrite(&record, sizeof record, 1, faces_) != 1;
  ++face_count_;
}

Status MeshSpool::Rewind() {
  if (failed_ || std::fflush(vertices_) != 0 || std::fflush(faces_) != 0) {
    return absl::ResourceExhaustedError("cannot write " + vertex_path_ + " or " + face_path_ +
                                        ": check the disk space");
  }
  std::rewind(vertices_);
  std::rewind(faces_);
  return absl::OkStatus();
}

bool MeshSpool::NextVertex(Eigen::Vector3d* p) { return std::fread(p->data(), sizeof(double), 3, vertices_) == 3; }

bool MeshSpool::NextFace(Triangle* face, int32_t* label) {
  FaceRecord record;
  if (std::fread(&record, sizeof record, 1, faces_) != 1) return false;
  *face = {record.vertex[0], record.vertex[1], record.vertex[2]};
  *label = record.label;
  return true;
}

Status WriteSpooledPly(const std::string& path, MeshSpool& spool) {
  TESSERA_RETURN_IF_ERROR(spool.Rewind());
  PlyLayout layout;
  layout.vertices = spool.vertex_count();
  layout.faces = spool.face_count();
  layout.has_labels = true;
  TESSERA_ASSIGN_OR_RETURN(PlyStream out, PlyStream::Create(path, layout));
  Eigen::Vector3d p;
  while (spool.NextVertex(&p)) out.AddVertex(p);
  PlyFace face;
  while (spool.NextFace(&face.vertices, &face.label)) out.AddFace(face);
  return out.Finish();
}

Status DropSmallComponents(MeshSpool& from, int64_t min_faces, MeshSpool& to) {
  TESSERA_RETURN_IF_ERROR(from.Rewind());
  std::vector<uint32_t> parent(from.vertex_count());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root = [&](uint32_t v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  Triangle face;
  int32_t label;
  while (from.NextFace(&face, &label)) {
    for (int k = 1; k < 3; ++k) {
      const uint32_t a = root(face[0]), b = root(face[k]);
      if (a < b)
        parent[b] = a;
      else
        parent[a] = b;
    }
  }
  std::vector<uint32_t> faces_at_root(parent.size(), 0);
  TESSERA_RETURN_IF_ERROR(from.Rewind());
  while (from.NextFace(&face, &label)) ++faces_at_root[root(face[0])];
  // Reuse `parent` for the new index of each vertex; kGone: removed.
  constexpr uint32_t kGone = ~0u;
  for (uint32_t v = 0; v < parent.size(); ++v) parent[v] = root(v);
  uint32_t next = 0;
  Eigen::Vector3d p;
  for (uint32_t& v : parent) {
    if (!from.NextVertex(&p)) return absl::InternalError("mesh spool: fewer vertices than were added");
    if (faces_at_root[v] >= min_faces) {
      to.AddVertex(p);
      v = next++;
    } else {
      v = kGone;
    }
  }
  TESSERA_RETURN_IF_ERROR(from.Rewind());
  while (from.NextFace(&face, &label)) {
    if (parent[face[0]] != kGone) to.AddFace({parent[face[0]], parent[face[1]], parent[face[2]]}, label);
  }
  return absl::OkStatus();
}

}  // namespace tessera
