// Splits the faces of a file into triangles.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "common/meshio/mesh_content.h"

namespace tessera {

// The most vertices of a face. Larger counts are taken for damage.
inline constexpr int64_t kMaxFaceVertices = 1000;
std::string ExpectedVertexCount();  // for messages

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
