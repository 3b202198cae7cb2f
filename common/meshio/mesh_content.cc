#include "common/meshio/mesh_content.h"

#include <new>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"

namespace tessera {
namespace {

class ContentSink : public MeshSink {
 public:
  Status Begin(const MeshLayout& layout) override {
    layout_ = layout;
    content_.float_positions = layout.float_positions;
    content_.label_property = layout.label_property;
    content_.mesh.vertices.reserve(static_cast<size_t>(layout.vertices));
    content_.mesh.faces.reserve(static_cast<size_t>(layout.faces));
    if (layout.labels == MeshLabels::kOfFaces) content_.mesh.labels.reserve(static_cast<size_t>(layout.faces));
    if (layout.labels == MeshLabels::kOfVertices) vertex_labels_.reserve(static_cast<size_t>(layout.vertices));
    return absl::OkStatus();
  }
  void AddVertex(const Eigen::Vector3d& position, int32_t label) override {
    content_.mesh.vertices.push_back(position);
    if (layout_.labels == MeshLabels::kOfVertices) vertex_labels_.push_back(label);
  }
  void AddFace(const Triangle& vertices, int32_t label) override {
    content_.mesh.faces.push_back(vertices);
    if (layout_.labels == MeshLabels::kOfFaces) content_.mesh.labels.push_back(label);
  }
  MeshContent Finish(const MeshReadOptions& options) {
    TriangleMesh& mesh = content_.mesh;
    if (layout_.labels == MeshLabels::kOfVertices) {
      mesh.labels.resize(mesh.faces.size());
      LabelFacesByVertices(mesh.faces, vertex_labels_, layout_.label_property, options, mesh.labels);
    }
    return std::move(content_);
  }

 private:
  MeshLayout layout_;
  MeshContent content_;
  std::vector<int32_t> vertex_labels_;
};

class CountingSink : public MeshSink {
 public:
  Status Begin(const MeshLayout&) override { return absl::OkStatus(); }
  void AddVertex(const Eigen::Vector3d&, int32_t) override {}
  void AddFace(const Triangle&, int32_t) override { ++triangles_; }
  int64_t triangles() const { return triangles_; }

 private:
  int64_t triangles_ = 0;
};

}  // namespace

int32_t MaterialNames::IndexOf(std::string_view name) {
  const auto [found, is_new] = indices_.try_emplace(std::string(name), static_cast<int32_t>(names_.size()));
  if (is_new) names_.emplace_back(name);
  return found->second;
}

void MeshReadOptions::Warn(const std::string& text) const {
  if (warnings != nullptr) warnings->push_back(absl::StrCat(file_in_warnings, ": ", text));
}

StatusOr<MeshContent> CollectMesh(const std::string& name, const MeshReadOptions& options,
                                  const std::function<Status(MeshSink&)>& stream) {
  try {
    ContentSink sink;
    TESSERA_RETURN_IF_ERROR(stream(sink));
    return sink.Finish(options);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat(name, ": not enough memory for the mesh"));
  }
}

StatusOr<int64_t> CountTriangles(const std::function<Status(MeshSink&)>& stream) {
  CountingSink sink;
  TESSERA_RETURN_IF_ERROR(stream(sink));
  return sink.triangles();
}

void LabelFacesByVertices(std::span<const Triangle> faces, std::span<const int32_t> vertex_labels,
                          const std::string& label_property, const MeshReadOptions& options,
                          std::span<int32_t> labels) {
  int64_t mixed = 0;
  size_t first_mixed = 0;
  for (size_t f = 0; f < faces.size(); ++f) {
    const int32_t a = vertex_labels[faces[f][0]], b = vertex_labels[faces[f][1]], c = vertex_labels[faces[f][2]];
    labels[f] = b == c ? b : a;
    if (a == b && b == c) continue;
    if (mixed++ == 0) first_mixed = f;
  }
  options.Warn(absl::StrCat("labels are those of the vertices ('", Printable(label_property),
                            "'): each face takes the label of most of its vertices; ", mixed,
                            " faces have vertices of different labels",
                            mixed > 0 ? absl::StrCat(" (first: face ", first_mixed, ")") : ""));
}

std::string ExpectedVertexCount() { return absl::StrCat("3 to ", kMaxFaceVertices, " vertices"); }

void PolygonFan::AddFace(std::span<const uint32_t> vertices, int32_t label, int64_t place) {
  for (size_t k = 2; k < vertices.size(); ++k) sink_.AddFace({vertices[0], vertices[k - 1], vertices[k]}, label);
  if (vertices.size() == 3) return;
  if (polygons_++ == 0) first_place_ = place;
  triangles_ += static_cast<int64_t>(vertices.size()) - 2;
}

void PolygonFan::Warn(const char* unit, const MeshReadOptions& options) const {
  if (polygons_ == 0) return;
  options.Warn(absl::StrCat(polygons_, " faces of more than 3 vertices split into ", triangles_,
                            " triangles (first: ", unit, " ", first_place_, ")"));
}

}  // namespace tessera
