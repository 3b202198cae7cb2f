#include "common/meshio/polygon_fan.h"

#include "absl/strings/str_cat.h"

namespace tessera {

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
