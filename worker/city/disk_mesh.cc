#include "worker/city/disk_mesh.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/meshio/mesh_format.h"
#include "common/scene/scene.h"
#include "worker/city/local_grid.h"

namespace tessera {
namespace {

class DiskSink : public MeshSink {
 public:
  DiskSink(const SceneDescription& scene, const std::string& path, const std::string& scratch_folder)
      : scene_(scene), path_(path), scratch_folder_(scratch_folder) {}

  // The lists grow, because faces of more than three vertices give more triangles than the file declares.
  Status Begin(const MeshLayout& layout) override {
    layout_ = layout;
    mesh_.float_positions = layout.float_positions;
    TESSERA_ASSIGN_OR_RETURN(vertices_, ScratchList<Eigen::Vector3d>::Create(scratch_folder_));
    TESSERA_ASSIGN_OR_RETURN(faces_, ScratchList<Triangle>::Create(scratch_folder_));
    if (layout.labels != MeshLabels::kNone) {
      TESSERA_ASSIGN_OR_RETURN(labels_, ScratchList<int32_t>::Create(scratch_folder_));
    }
    return absl::OkStatus();
  }
  void AddVertex(const Eigen::Vector3d& position, int32_t label) override {
    mesh_.largest_coordinate_m = std::max(mesh_.largest_coordinate_m, position.cwiseAbs().maxCoeff());
    vertices_->Append(OnLocalGrid(scene_.frame.LocalFromScene(position)));
    if (layout_.labels == MeshLabels::kOfVertices) labels_->Append(label);
  }
  void AddFace(const Triangle& vertices, int32_t label) override {
    faces_->Append(vertices);
    if (layout_.labels == MeshLabels::kOfFaces) labels_->Append(label);
  }
  StatusOr<DiskMesh> Finish(const MeshReadOptions& options) {
    TESSERA_ASSIGN_OR_RETURN(mesh_.vertices, vertices_->Finish());
    TESSERA_ASSIGN_OR_RETURN(mesh_.faces, faces_->Finish());
    if (labels_) {
      TESSERA_ASSIGN_OR_RETURN(mesh_.labels, labels_->Finish());
    }
    if (layout_.labels == MeshLabels::kOfVertices) {
      const ScratchArray<int32_t> of_vertices = std::move(mesh_.labels);
      TESSERA_ASSIGN_OR_RETURN(mesh_.labels, ScratchArray<int32_t>::Create(scratch_folder_, mesh_.faces.size()));
      LabelFacesByVertices(mesh_.spans().faces, of_vertices.values(), layout_.label_property, options,
                           mesh_.labels.values());
    }
    if (mesh_.faces.size() == 0) return InputError(path_, "", "no faces", "at least one face");
    for (size_t f = 0; f < mesh_.labels.size(); ++f) {
      TESSERA_RETURN_IF_ERROR(CheckFaceLabel(scene_, path_, f, mesh_.labels[f], layout_.label_property));
    }
    return std::move(mesh_);
  }

 private:
  const SceneDescription& scene_;
  const std::string& path_;
  const std::string& scratch_folder_;
  MeshLayout layout_;
  DiskMesh mesh_;
  std::optional<ScratchList<Eigen::Vector3d>> vertices_;
  std::optional<ScratchList<Triangle>> faces_;
  std::optional<ScratchList<int32_t>> labels_;  // of faces or vertices
};

}  // namespace

StatusOr<DiskMesh> ReadMeshToDisk(const SceneDescription& scene, const std::string& scratch_folder,
                                  Warnings* warnings) {
  if (scene.mesh_path.empty()) return InputError(scene.folder, "", "no mesh", "a scene with a mesh");
  const std::string path = absl::StrCat(scene.folder, "/", scene.mesh_path);
  const MeshReadOptions options = {scene.label_property, warnings, scene.mesh_path};
  DiskSink sink(scene, path, scratch_folder);
  TESSERA_RETURN_IF_ERROR(StreamMesh(path, options, &sink));
  return sink.Finish(options);
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
