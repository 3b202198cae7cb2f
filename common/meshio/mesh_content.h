// A mesh as files hold it, whole or element by element.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"

namespace tessera {

struct MeshContent {
  TriangleMesh mesh;             // labels empty if the file has none
  std::string label_property;    // name of the labels' property in the file; empty without labels
  bool float_positions = false;  // the file stores x, y, z as 32-bit floats
};

// Names of materials, each once, in the order of their first use. May be shared by several files.
class MaterialNames {
 public:
  // The index of `name`, which is added if it is new.
  int32_t IndexOf(std::string_view name);
  const std::vector<std::string>& names() const { return names_; }

 private:
  std::vector<std::string> names_;
  std::unordered_map<std::string, int32_t> indices_;
};

struct MeshReadOptions {
  // The property of faces or vertices that holds the labels. Empty: labels are not read. None: it is found by its name
  // (ply_labels.h).
  std::optional<std::string> label_property = {};
  // Receives each conversion of unusual content, with `file_in_warnings`, the count and the first place. May be null.
  Warnings* warnings = nullptr;
  std::string file_in_warnings = {};
  // If given, labels are the materials of the faces: indices into these names, -1 without material. `label_property` is
  // then ignored. INVALID_ARGUMENT for formats without materials.
  MaterialNames* materials = nullptr;
  // For messages: who names label_property, and how the user says that there are no labels.
  const char* label_option = "scene.json names in \"label_property\"";
  const char* without_labels = "set \"label_property\": null in scene.json";
  // Reads the property `confidence` of a PLY's faces, which this program writes (MeshSink::SetConfidence).
  bool confidence = false;

  void Warn(const std::string& text) const;
};

enum class MeshLabels { kNone, kOfFaces, kOfVertices };

// What a file declares before its elements.
struct MeshLayout {
  // Expected numbers, for reservations only: bounded by the file's size, and 0 if the file declares none. Faces of more
  // than three vertices give more triangles.
  int64_t vertices = 0, faces = 0;
  MeshLabels labels = MeshLabels::kNone;
  std::string label_property;  // empty without labels
  bool float_positions = false;
  bool has_confidence = false;  // only if MeshReadOptions::confidence
};

// Receives a mesh element by element, in the order of the file.
class MeshSink {
 public:
  virtual ~MeshSink() = default;
  // Called first. The file may be shorter than declared.
  virtual Status Begin(const MeshLayout& layout) = 0;
  virtual void AddVertex(const Eigen::Vector3d& position, int32_t label) = 0;  // `label`: 0 unless kOfVertices
  // If MeshLayout::has_confidence: called before AddFace of each triangle of a face.
  virtual void SetConfidence(float /*confidence*/) {}
  // The indices may be those of later vertices. If there is no such vertex, the reader returns an error at the end.
  virtual void AddFace(const Triangle& vertices, int32_t label) = 0;  // `label`: 0 unless kOfFaces
};

// Collects what `stream` adds to its sink. RESOURCE_EXHAUSTED with `name` if the memory is too small for the mesh.
StatusOr<MeshContent> CollectMesh(const std::string& name, const MeshReadOptions& options,
                                  const std::function<Status(MeshSink&)>& stream);

// The number of triangles that `stream` adds to its sink.
StatusOr<int64_t> CountTriangles(const std::function<Status(MeshSink&)>& stream);

// For files with kOfVertices. Gives each face the label of two or three of its vertices, or that of its first vertex if
// all three differ. Warns, with the number of faces whose vertices differ.
void LabelFacesByVertices(std::span<const Triangle> faces, std::span<const int32_t> vertex_labels,
                          const std::string& label_property, const MeshReadOptions& options, std::span<int32_t> labels);

// The most vertices of a face. Larger counts are taken for damage.
inline constexpr int64_t kMaxFaceVertices = 1000;
std::string ExpectedVertexCount();  // for messages

// Splits the faces of a file into triangles.
class PolygonFan {
 public:
  explicit PolygonFan(MeshSink& sink) : sink_(sink) {}
  // Adds a fan of triangles around the first of three or more vertices. `place`: the face's line or byte offset.
  void AddFace(std::span<const uint32_t> vertices, int32_t label, int64_t place);
  // Warns if there were faces of more than three vertices. `unit` of the places: "line" or "byte".
  void Warn(const char* unit, const MeshReadOptions& options) const;

 private:
  MeshSink& sink_;
  int64_t polygons_ = 0, triangles_ = 0;  // faces of more than three vertices, and what they became
  int64_t first_place_ = 0;
};

}  // namespace tessera
