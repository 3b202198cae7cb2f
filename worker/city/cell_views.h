// The cells of the ground and the views that each of them is refined from.
#ifndef TESSERA_WORKER_CITY_CELL_VIEWS_H_
#define TESSERA_WORKER_CITY_CELL_VIEWS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/geometry/mesh.h"
#include "common/tile/survey.h"
#include "worker/city/city_file.h"
#include "worker/city/view_choice.h"

namespace tessera {

struct CellViewOptions {
  int samples = 48;                // faces of a cell that are tested, at even steps through its list
  double up_elevation_rad = 1.05;  // a view from higher than this is one from above
  double min_cosine = 0.1;         // between a face's normal and the direction to the camera
  ViewChoiceOptions choice;
  // Larger cities are tested against their coarse shape and, near a face, against its neighbourhood in full.
  int64_t max_whole_faces = 4 << 20;
};

// Chooses the views of survey->cells (CellsOf the city), from survey->ground, survey->views and survey->up. A cell's
// views are those that see most of it (pixels of its faces that are unhidden, by rays) in good detail, balanced over
// directions, so that facades keep their oblique pairs. `scratch_folder` takes 4 bytes a vertex meanwhile. `whole`: the
// mesh that `city` has in blocks, local frame. A function of the mesh and the views alone, whatever the tiling.
// CANCELLED follows `control`; errors as CityReader::Block's.
Status ChooseViews(const MeshSpans& whole, const CityReader& city, const CellViewOptions& options,
                   const TaskControl& control, const std::string& scratch_folder, Survey* survey);

}  // namespace tessera

#endif  // TESSERA_WORKER_CITY_CELL_VIEWS_H_
