// Collects faces from blocks of the city into one mesh.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/geometry/mesh.h"
#include "worker/city/city_file.h"

namespace tessera {

// Faces and the vertices they use, both ordered by global id.
struct CollectedFaces {
  TriangleMesh mesh;
  std::vector<uint32_t> vertex_ids, face_ids;  // ascending
};

// Copies its input; the blocks need not outlive it. Not thread-safe.
class FaceCollector {
 public:
  // Adds a face. Each face may be added once.
  void Add(const CityBlock& block, size_t face);
  // Returns the mesh of all added faces and empties the collector. The order of adding does not matter.
  CollectedFaces Finish();

 private:
  static constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
  struct Vertex {
    uint32_t id;  // global
    Eigen::Vector3d position;
  };
  struct Face {
    uint32_t id;  // global
    int32_t label;
    Triangle vertices;  // indices in `vertices_`
  };
  std::vector<Face> faces_;
  std::vector<Vertex> vertices_;     // unordered; a vertex of two blocks is there twice
  std::vector<uint32_t> place_;      // per vertex of the current block: index in `vertices_`, or kNone
  const uint32_t* block_ = nullptr;  // identifies the current block
};

// The faces whose centroid lies in a rectangle of cells. Errors as CityReader::Block; CANCELLED.
StatusOr<CollectedFaces> CollectCells(const CityReader& city, const GroundPlane& ground, const CellRect& rect,
                                      const TaskControl& control = {});

}  // namespace tessera
