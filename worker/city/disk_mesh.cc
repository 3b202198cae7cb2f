#include "worker/city/disk_mesh.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "common/meshio/mesh_format.h"
#include "worker/city/local_grid.h"

namespace tessera {
namespace {

class DiskSink : public MeshSink {
 public:
  DiskSink(const SceneDescription& scene, const std::string& path, const std::string& scratch_folder)
      : scene_(scene), path_(path), scratch_folder_(scratch_folder) {}

  Status Begin(int64_t vertices, int64_t faces, bool has_labels, bool float_positions) override {
    // The header's reader has checked the counts against the file's size.
    mesh_.float_positions = float_positions;
    has_labels_ = has_labels;
    TESSERA_ASSIGN_OR_RETURN(mesh_.vertices,
                             ScratchArray<Eigen::Vector3d>::Create(scratch_folder_, static_cast<size_t>(vertices)));
    TESSERA_ASSIGN_OR_RETURN(mesh_.faces, ScratchArray<Triangle>::Create(scratch_folder_, static_cast<size_t>(faces)));
    if (has_labels) {
      TESSERA_ASSIGN_OR_RETURN(mesh_.labels,
                               ScratchArray<int32_t>::Create(scratch_folder_, static_cast<size_t>(faces)));
    }
    return absl::OkStatus();
  }
  void AddVertex(const Eigen::Vector3d& position) override {
    mesh_.largest_coordinate_m = std::max(mesh_.largest_coordinate_m, position.cwiseAbs().maxCoeff());
    mesh_.vertices[vertices_++] = OnLocalGrid(scene_.frame.LocalFromScene(position));
  }
  void AddFace(const Triangle& vertices, int32_t label) override {
    if (has_labels_) {
      const int classes = static_cast<int>(scene_.classes.size());
      if (label_status_.ok() && (label < -1 || label >= classes)) {
        label_status_ = InputError(path_, absl::StrCat("face ", faces_), absl::StrCat("label ", label),
                                   absl::StrCat("0 to ", classes - 1, " (index into classes), or -1 for no label"));
      }
      mesh_.labels[faces_] = label;
    }
    mesh_.faces[faces_++] = vertices;
  }
  StatusOr<DiskMesh> Finish() {
    if (mesh_.faces.size() == 0) return InputError(path_, "", "no faces", "a mesh");
    TESSERA_RETURN_IF_ERROR(label_status_);
    return std::move(mesh_);
  }

 private:
  const SceneDescription& scene_;
  const std::string& path_;
  const std::string& scratch_folder_;
  DiskMesh mesh_;
  bool has_labels_ = false;
  size_t vertices_ = 0, faces_ = 0;  // so far
  Status label_status_;
};

}  // namespace

StatusOr<DiskMesh> ReadMeshToDisk(const SceneDescription& scene, const std::string& scratch_folder) {
  if (scene.mesh_path.empty()) return InputError(scene.folder, "", "no mesh", "a scene with a mesh");
  const std::string path = absl::StrCat(scene.folder, "/", scene.mesh_path);
  DiskSink sink(scene, path, scratch_folder);
  TESSERA_RETURN_IF_ERROR(StreamMesh(path, &sink));
  return sink.Finish();
}

Status CompleteLabels(bool has_likelihoods, const std::string& scratch_folder, DiskMesh* mesh) {
  if (mesh->labels.size() > 0) return absl::OkStatus();
  TESSERA_ASSIGN_OR_RETURN(mesh->labels, ScratchArray<int32_t>::Create(scratch_folder, mesh->faces.size()));
  const std::span<int32_t> labels = mesh->labels.values();
  std::fill(labels.begin(), labels.end(), has_likelihoods ? -1 : 0);
  return absl::OkStatus();
}

TriangleMesh PickFaces(const MeshSpans& mesh, const std::vector<size_t>& faces) {
  TriangleMesh picked;
  for (const size_t f : faces) {
    const auto first = static_cast<uint32_t>(picked.vertices.size());
    for (int k = 0; k < 3; ++k) picked.vertices.push_back(mesh.Corner(f, k));
    picked.faces.push_back({first, first + 1, first + 2});
  }
  return picked;
}

}  // namespace tessera
