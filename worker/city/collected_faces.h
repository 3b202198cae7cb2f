// Faces picked from blocks of the city, put together as a mesh.
#ifndef TESSERA_WORKER_CITY_COLLECTED_FACES_H_
#define TESSERA_WORKER_CITY_COLLECTED_FACES_H_

#include <Eigen/Core>
#include <cstdint>
#include <utility>
#include <vector>

#include "common/geometry/mesh.h"
#include "worker/city/city_file.h"

namespace tessera {

// Faces and the vertices they use, both in the order of their global ids.
struct CollectedFaces {
  TriangleMesh mesh;
  std::vector<uint32_t> vertex_ids, face_ids;  // ascending
  std::vector<uint8_t> marked;                 // faces
};

// Copies what it is given; the blocks need not outlive it. Not thread-safe.
class FaceCollector {
 public:
  // A face, at most once.
  void Add(const CityBlock& block, size_t face, bool marked);
  // All of them; the collector is empty afterwards. The order of adding does not matter.
  CollectedFaces Finish();

 private:
  struct Picked {
    uint32_t id;
    Triangle vertices;  // global
    int32_t label;
    uint8_t marked;
  };
  std::vector<Picked> faces_;
  std::vector<std::pair<uint32_t, Eigen::Vector3d>> vertices_;  // by global id; in no order, some more than once
  std::vector<uint8_t> taken_;                                  // vertices of the block at hand that are in vertices_
  const uint32_t* block_ = nullptr;                             // identifies the block at hand
};

}  // namespace tessera

#endif  // TESSERA_WORKER_CITY_COLLECTED_FACES_H_
