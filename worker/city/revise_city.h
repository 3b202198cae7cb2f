// A city whose mesh changed in places: what is the same keeps its ids.
#ifndef TESSERA_WORKER_CITY_REVISE_CITY_H_
#define TESSERA_WORKER_CITY_REVISE_CITY_H_

#include <array>
#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/imaging/camera.h"
#include "common/job/ground.h"
#include "worker/city/city_file.h"
#include "worker/city/disk_mesh.h"
#include "worker/refine/density.h"

namespace tessera {

struct RevisedCity {
  DiskMesh mesh;                                // split; vertices and faces by ascending id
  ScratchArray<uint32_t> vertex_ids, face_ids;  // of these
  int64_t vertex_ids_end = 0, face_ids_end = 0;
  int64_t kept_faces = 0;                      // of the city
  std::set<std::array<int, 2>> changed_cells;  // (x, y) of those that lost a face or got one

  CitySpans spans() const {
    return {mesh.spans(),      mesh.input_face.values(), vertex_ids.values(),
            face_ids.values(), vertex_ids_end,           face_ids_end};
  }
};

// Takes `city`, which is a split of `base`, on to the mesh `now`; both repaired, with labels, in the local frame. A
// face of `now` is one of `base` if it has the same label and the same corners, bit for bit, in the same turn; what the
// city split it into stays, under its ids, where the vertices about it are the same ones as well. Other faces are split
// for `cameras`, at edges that they share with faces that stay as those are: the surface has no cracks. They and their
// vertices get ids that were never used; ids of what went are used no more. The city of a mesh that did not change is
// the same. Memory: what changed, and the faces about it. CANCELLED follows `control`; DATA_LOSS if `city` is damaged
// or no split of `base`.
StatusOr<RevisedCity> ReviseCity(const CityReader& city, const DiskMesh& base, const DiskMesh& now,
                                 const GroundPlane& ground, const std::vector<PosedCamera>& cameras,
                                 const DensityOptions& density, const std::string& scratch_folder,
                                 const TaskControl& control);

}  // namespace tessera

#endif  // TESSERA_WORKER_CITY_REVISE_CITY_H_
