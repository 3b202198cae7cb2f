// Putting the city together again from its stitched cores.
#ifndef TESSERA_WORKER_TASKS_MERGE_CORES_H_
#define TESSERA_WORKER_TASKS_MERGE_CORES_H_

#include <string>
#include <vector>

#include "common/base/status.h"
#include "worker/tasks/city_file.h"
#include "worker/tasks/tile_files.h"

namespace tessera {

// Takes cores one by one and checks that they fit. Not thread-safe.
class CoreMerger {
 public:
  // `city` must outlive the merger.
  explicit CoreMerger(const City& city);

  // DATA_LOSS if a face was in an earlier core, if a vertex was there at another position (in any bit), or if the core
  // names what the city has not.
  Status Add(const TileCore& core);

  // DATA_LOSS if a face is in no core or a vertex of a face has no position. Afterwards mesh() is the result: vertices
  // and faces by global id, the city's topology, local frame.
  Status Finish();

  const TriangleMesh& mesh() const { return mesh_; }
  const std::vector<float>& confidence() const { return confidence_; }
  // Tile whose core has the face.
  const std::vector<int32_t>& tile_of_face() const { return tile_of_face_; }

 private:
  const City& city_;
  TriangleMesh mesh_;
  std::vector<float> confidence_;
  std::vector<int32_t> tile_of_face_, tile_of_vertex_;  // -1: none yet
};

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_MERGE_CORES_H_
