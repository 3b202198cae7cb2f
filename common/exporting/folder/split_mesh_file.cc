#include "common/exporting/folder/split_mesh_file.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/geometry/nearest_surface.h"
#include "common/meshio/mesh_format.h"

namespace tessera {
namespace {

constexpr double kReadShare = 0.4;  // of the time, for reading the file
constexpr int64_t kElementsPerCheck = 1 << 16;

// Gives the elements of a file to a splitter.
class SplitterSink : public MeshSink {
 public:
  SplitterSink(const std::string& path, const ExportScene& scene, const SplitFileOptions& options,
               const TaskControl& control)
      : path_(path), scene_(scene), options_(options), control_(control) {}

  Status Begin(const MeshLayout& layout) override {
    needs_whole_mesh_ = layout.labels == MeshLabels::kOfVertices;
    if (needs_whole_mesh_) return absl::FailedPreconditionError("labels of vertices");
    has_labels_ = layout.labels == MeshLabels::kOfFaces;
    expected_ = std::max<int64_t>(layout.vertices + layout.faces, 1);
    return Start(layout.has_confidence);
  }
  Status Start(bool has_confidence) {
    SplitOptions split;
    split.ground = scene_.ground;
    split.has_confidence = has_confidence;
    split.allowed = options_.allowed;
    TESSERA_ASSIGN_OR_RETURN(splitter_, SheetSplitter::Create(options_.scratch_folder, std::move(split)));
    return absl::OkStatus();
  }
  void AddVertex(const Eigen::Vector3d& position, int32_t /*label*/) override {
    splitter_->AddVertex(scene_.frame.LocalFromScene(position));
    Count();
  }
  void SetConfidence(float confidence) override {
    confidence_ = confidence >= 0 ? std::min(confidence, 1.0f) : 0.0f;  // also if it is not a number
  }
  void AddFace(const Triangle& face, int32_t label) override {
    const int32_t kept = has_labels_ ? label : -1;
    if (fault_.ok() && (kept < -1 || kept >= static_cast<int32_t>(scene_.classes.size()))) {
      fault_ = InputError(path_, absl::StrCat("face ", faces_), absl::StrCat("label ", label),
                          absl::StrCat("0 to ", scene_.classes.size() - 1, " (a class of the scene) or -1"));
    }
    splitter_->AddFace(face, kept, confidence_);
    ++faces_;
    Count();
  }
  // For meshes with labels of vertices.
  Status AddMesh(const MeshContent& content) {
    has_labels_ = !content.mesh.labels.empty();
    expected_ = static_cast<int64_t>(content.mesh.vertices.size() + content.mesh.faces.size());
    TESSERA_RETURN_IF_ERROR(Start(/*has_confidence=*/false));
    for (const Eigen::Vector3d& position : content.mesh.vertices) AddVertex(position, 0);
    for (size_t f = 0; f < content.mesh.faces.size(); ++f) {
      AddFace(content.mesh.faces[f], has_labels_ ? content.mesh.labels[f] : -1);
    }
    return absl::OkStatus();
  }
  bool needs_whole_mesh() const { return needs_whole_mesh_; }
  StatusOr<std::vector<SheetEntry>> Finish() {
    TESSERA_RETURN_IF_ERROR(control_.Check());
    TESSERA_RETURN_IF_ERROR(fault_);
    if (faces_ == 0) return InputError(path_, "", "no faces", "at least one face");
    return splitter_->Finish(options_.sheets_folder, PartOf(control_, kReadShare, 1));
  }

 private:
  void Count() {
    if (++elements_ % kElementsPerCheck != 0) return;
    control_.Report(kReadShare * std::min(1.0, static_cast<double>(elements_) / static_cast<double>(expected_)),
                    "reading the mesh");
  }

  const std::string& path_;
  const ExportScene& scene_;
  const SplitFileOptions& options_;
  const TaskControl& control_;
  std::optional<SheetSplitter> splitter_;
  Status fault_;  // the first wrong label
  bool has_labels_ = false, needs_whole_mesh_ = false;
  float confidence_ = 0;
  int64_t faces_ = 0, elements_ = 0, expected_ = 1;
};

}  // namespace

StatusOr<std::vector<SheetEntry>> SplitMeshFile(const std::string& path, const ExportScene& scene,
                                                const SplitFileOptions& options, const TaskControl& control) {
  SplitterSink sink(path, scene, options, control);
  const Status streamed = StreamMesh(path, options.read, &sink);
  if (sink.needs_whole_mesh()) {
    TESSERA_ASSIGN_OR_RETURN(const MeshContent content, ReadMesh(path, options.read));
    TESSERA_RETURN_IF_ERROR(sink.AddMesh(content));
  } else {
    TESSERA_RETURN_IF_ERROR(streamed);
  }
  return sink.Finish();
}

StatusOr<std::vector<float>> DisplacementOf(const Sheet& sheet, std::span<const Sheet> start) {
  TriangleMesh mesh;
  for (const Sheet& part : start) {
    const auto first = static_cast<uint32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), part.vertices.begin(), part.vertices.end());
    for (const Triangle& face : part.faces) mesh.faces.push_back({face[0] + first, face[1] + first, face[2] + first});
  }
  if (mesh.faces.empty()) {
    return absl::InvalidArgumentError(
        "the start mesh: found no faces near a part of the result, expected the mesh that the result was made of");
  }
  const NearestSurface surface(mesh);
  std::vector<float> displacement_m(sheet.vertices.size());
  ParallelForEach(sheet.vertices.size(), 256, [&](size_t v) {
    displacement_m[v] = static_cast<float>(surface.Find(sheet.vertices[v]).distance_m);
  });
  return displacement_m;
}

}  // namespace tessera
