// What ingest hands on: the mesh of the whole city.
#ifndef TESSERA_WORKER_TASKS_CITY_FILE_H_
#define TESSERA_WORKER_TASKS_CITY_FILE_H_

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"

namespace tessera {

// The whole mesh after repair and splitting, local frame. Its indices are the global ids of vertices and faces; its
// topology is that of the result.
struct City {
  TriangleMesh mesh;                // labels: one a face; -1: not labelled
  std::vector<int64_t> input_face;  // face of the scene's mesh that each face is a part of
};

Status WriteCity(const std::string& path, const City& city);
// DATA_LOSS if the file is damaged or its parts do not fit together.
StatusOr<City> ReadCity(const std::string& path);

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_CITY_FILE_H_
