#include "worker/city/mesh_arrays.h"

#include <cstring>

namespace tessera {

void PutPoints(const std::vector<Eigen::Vector3d>& points, const std::string& name, ArrayFile* file) {
  std::vector<double> values;
  values.reserve(3 * points.size());
  for (const Eigen::Vector3d& p : points) values.insert(values.end(), {p.x(), p.y(), p.z()});
  file->arrays[name] = std::move(values);
}

StatusOr<std::vector<Eigen::Vector3d>> TakePoints(const std::string& name, int64_t count, ArrayFile* file) {
  TESSERA_ASSIGN_OR_RETURN(const std::vector<double> values, file->Take<double>(name, count < 0 ? -1 : 3 * count));
  if (values.size() % 3 != 0) return absl::DataLossError(file->name + ": " + name + ": expected 3 values per point");
  std::vector<Eigen::Vector3d> points(values.size() / 3);
  for (size_t i = 0; i < points.size(); ++i) points[i] = {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
  return points;
}

void PutMesh(const TriangleMesh& mesh, const std::string& name, ArrayFile* file) {
  PutPoints(mesh.vertices, name + ".vertices", file);
  std::vector<uint32_t> corners;
  corners.reserve(3 * mesh.faces.size());
  for (const Triangle& face : mesh.faces) corners.insert(corners.end(), face.begin(), face.end());
  file->arrays[name + ".faces"] = std::move(corners);
  file->arrays[name + ".labels"] = mesh.labels;
}

StatusOr<TriangleMesh> TakeMesh(const std::string& name, ArrayFile* file) {
  TriangleMesh mesh;
  TESSERA_ASSIGN_OR_RETURN(mesh.vertices, TakePoints(name + ".vertices", -1, file));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint32_t> corners, file->Take<uint32_t>(name + ".faces"));
  TESSERA_ASSIGN_OR_RETURN(mesh.labels, file->Take<int32_t>(name + ".labels"));
  if (corners.size() % 3 != 0)
    return absl::DataLossError(file->name + ": " + name + ".faces: expected 3 indices per face");
  mesh.faces.resize(corners.size() / 3);
  for (size_t i = 0; i < corners.size(); ++i) {
    if (corners[i] >= mesh.vertices.size()) {
      return absl::DataLossError(file->name + ": " + name + ".faces: found vertex " + std::to_string(corners[i]) +
                                 ", expected less than " + std::to_string(mesh.vertices.size()));
    }
    mesh.faces[i / 3][i % 3] = corners[i];
  }
  if (!mesh.labels.empty() && mesh.labels.size() != mesh.faces.size()) {
    return absl::DataLossError(file->name + ": " + name + ".labels: found " + std::to_string(mesh.labels.size()) +
                               ", expected " + std::to_string(mesh.faces.size()));
  }
  return mesh;
}

}  // namespace tessera
