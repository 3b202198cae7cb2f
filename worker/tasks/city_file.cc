#include "worker/tasks/city_file.h"

#include "common/tile/array_file.h"
#include "worker/tasks/mesh_arrays.h"

namespace tessera {

Status WriteCity(const std::string& path, const City& city) {
  ArrayFile file;
  PutMesh(city.mesh, "mesh", &file);
  file.arrays["input_face"] = city.input_face;
  return WriteArrayFile(path, file);
}

StatusOr<City> ReadCity(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(ArrayFile file, ReadArrayFile(path));
  City city;
  TESSERA_ASSIGN_OR_RETURN(city.mesh, TakeMesh("mesh", &file));
  const int64_t faces = static_cast<int64_t>(city.mesh.faces.size());
  TESSERA_ASSIGN_OR_RETURN(city.input_face, file.Take<int64_t>("input_face", faces));
  if (city.mesh.labels.size() != city.mesh.faces.size()) return absl::DataLossError(path + ": found no labels");
  return city;
}

}  // namespace tessera
