// The cells of the ground and the views that each of them is refined from.
#ifndef TESSERA_WORKER_CITY_CELL_VIEWS_H_
#define TESSERA_WORKER_CITY_CELL_VIEWS_H_

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/geometry/mesh.h"
#include "common/job/survey.h"
#include "worker/city/city_file.h"
#include "worker/city/city_sight.h"
#include "worker/city/view_choice.h"

namespace tessera {

struct CellViewOptions {
  int samples = 48;                 // faces of a cell that are tested, at even steps through its list
  double up_elevation_rad = 1.05;   // a view from higher than this is one from above
  double min_cosine = 0.1;          // between a face's normal and the direction to the camera
  double occlusion_margin_gsd = 3;  // nothing nearer to a face than that hides it
  ViewChoiceOptions choice;
  // Of each view, growing with its flight's date; empty: all are one. Where the newest epoch that sees anything of a
  // cell shows this share of what all show, in samples that two views see, the others are left out.
  std::vector<int> epoch_of_view;
  double enough = 0.9;
  // Larger cities are tested against their coarse shape and, near a face, against its neighbourhood in full.
  int64_t max_whole_faces = 4 << 20;
};

// The views of a cell with these `faces` of `mesh`, of those that may show it; ascending. `centres`: of all cameras.
std::vector<int32_t> ChooseViewsOfCell(const MeshSpans& mesh, const std::vector<uint32_t>& faces,
                                       const CitySight& sight, const std::vector<Eigen::Vector3d>& centres,
                                       const std::vector<size_t>& candidates, const Survey& survey,
                                       const CellViewOptions& options);

// The faces of the block by the cell that has them, (x, y).
std::map<std::pair<int, int>, std::vector<uint32_t>> FacesOfCells(const CityBlock& block, const GroundPlane& ground);

// Chooses the views of survey->cells (CellsOf the city), from survey->ground, survey->views and survey->up. A cell's
// views are those that see most of it (pixels of its faces that are unhidden, by rays) in good detail, balanced over
// directions, so that facades keep their oblique pairs. `scratch_folder` takes 4 bytes a vertex meanwhile. `whole`: the
// mesh that `city` has in blocks, local frame. A function of the mesh and the views alone, whatever the tiling.
// CANCELLED follows `control`; errors as CityReader::Block's.
Status ChooseViews(const MeshSpans& whole, const CityReader& city, const CellViewOptions& options,
                   const TaskControl& control, const std::string& scratch_folder, Survey* survey);

}  // namespace tessera

#endif  // TESSERA_WORKER_CITY_CELL_VIEWS_H_
