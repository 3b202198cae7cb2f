// Reads the city of a job into memory.
#pragma once

#include <absl/status/status.h>

#include <cstdint>
#include <string>
#include <vector>

#include "worker/city/city_file.h"

namespace tessera {

struct City {
  TriangleMesh mesh;
  std::vector<int64_t> input_face;
};

// FAILED_PRECONDITION if some ids are unused, as in the city of an update with another mesh.
inline StatusOr<City> ReadCity(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const CityReader reader, CityReader::Open(path));
  City city;
  if (reader.vertices() != reader.vertex_ids_end() || reader.faces() != reader.face_ids_end()) {
    return absl::FailedPreconditionError(
        path + ": found unused ids, expected contiguous ids; a city of an update cannot be read as a whole");
  }
  city.mesh.vertices.resize(static_cast<size_t>(reader.vertices()));
  city.mesh.faces.resize(static_cast<size_t>(reader.faces()));
  city.mesh.labels.resize(city.mesh.faces.size());
  city.input_face.resize(city.mesh.faces.size());
  for (size_t b = 0; b < reader.block_count(); ++b) {
    TESSERA_ASSIGN_OR_RETURN(const CityBlock block, reader.Block(b));
    for (size_t v = 0; v < block.vertex_ids.size(); ++v) {
      city.mesh.vertices[block.vertex_ids[v]] = block.mesh.vertices[v];
    }
    for (size_t f = 0; f < block.face_ids.size(); ++f) {
      const uint32_t id = block.face_ids[f];
      city.mesh.faces[id] = block.GlobalFace(f);
      city.mesh.labels[id] = block.mesh.labels[f];
      city.input_face[id] = block.input_face[f];
    }
  }
  return city;
}

}  // namespace tessera
