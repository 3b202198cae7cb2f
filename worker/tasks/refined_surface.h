// The tiles' current states, and a part of the city's surface with them.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "common/base/status.h"
#include "common/job/ground.h"
#include "worker/city/city_file.h"
#include "worker/city/collected_faces.h"
#include "worker/tasks/task.h"
#include "worker/tile/tile_files.h"

namespace tessera {

// The states of these tiles; their kStateFile are among the request's inputs. Errors as OpenState.
StatusOr<StatesOfTiles> OpenStates(const TaskRequest& request, const std::vector<int>& tiles);

// The faces that may be above `plan` (metres in the ground plane), with labels. Positions and labels are those of
// `states` where available, else of the start. Errors as the city's.
StatusOr<CollectedFaces> RefinedSurface(const CityReader& city, const GroundPlane& ground,
                                        const Eigen::AlignedBox2d& plan, const StatesOfTiles& states);

// The same for a rectangle of cells of width `cell_m`.
Eigen::AlignedBox2d PlanOf(const CellRect& cells, double cell_m, int margin_cells);

}  // namespace tessera
