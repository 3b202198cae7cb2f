// Updates a city whose mesh changed in places: unchanged faces keep their ids.
#pragma once

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
  ScratchArray<uint32_t> vertex_ids, face_ids;  // of `mesh`
  int64_t vertex_ids_end = 0, face_ids_end = 0;
  int64_t kept_faces = 0;                      // faces taken over from the old city
  std::set<std::array<int, 2>> changed_cells;  // (x, y) of cells that lost or gained a face

  CitySpans spans() const {
    return {mesh.spans(),      mesh.input_face.values(), vertex_ids.values(),
            face_ids.values(), vertex_ids_end,           face_ids_end};
  }
};

// Updates `city`, which is a split of `base`, to the mesh `now`. Both meshes are repaired, labelled and in the local
// frame.
// A face of `now` equals one of `base` if it has the same label, the same corners bit for bit and the same
// orientation, and if its vertices have the same incident fans. The city's faces that were split from such a face are
// kept with their ids. New faces are split for `cameras`; edges that they share with kept faces are split like those,
// so the surface has no cracks. New faces and vertices get ids that were never used; ids of removed ones are not
// reused. An unchanged mesh gives the same city.
// Memory: the changed faces and their neighbours. CANCELLED if `control` is cancelled; DATA_LOSS if `city` is damaged
// or not a split of `base`.
StatusOr<RevisedCity> ReviseCity(const CityReader& city, const DiskMesh& base, const DiskMesh& now,
                                 const GroundPlane& ground, const std::vector<PosedCamera>& cameras,
                                 const DensityOptions& density, const std::string& scratch_folder,
                                 const TaskControl& control);

}  // namespace tessera
