// Selects for each ground cell the views from which it is refined.
#pragma once

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
#include "worker/city/occlusion_test.h"
#include "worker/city/view_choice.h"

namespace tessera {

struct CellViewOptions {
  int samples = 48;                 // faces tested per cell, evenly spaced in its list
  double up_elevation_rad = 1.05;   // views from above are at least this high
  double min_cosine = 0.1;          // of the angle between a face's normal and the direction to the camera
  double occlusion_margin_gsd = 3;  // surfaces closer to a face than this do not occlude it
  ViewChoiceOptions choice;
  // Epoch of each view, increasing with the date of its flight; empty: one epoch. If the newest epoch that sees a
  // cell covers this share (`enough`) of what all views cover, in samples that two views see, older views are not
  // used.
  std::vector<int> epoch_of_view;
  double enough = 0.9;
  // Larger cities are tested against a simplified mesh, and against the full mesh only near a face.
  int64_t max_whole_faces = 4 << 20;
};

// Selects the views of a cell that consists of `faces` of `mesh`, from `candidates`; ascending. `centres`: of all
// cameras.
std::vector<int32_t> ChooseViewsOfCell(const MeshSpans& mesh, const std::vector<uint32_t>& faces,
                                       const OcclusionTest& occlusion, const std::vector<Eigen::Vector3d>& centres,
                                       const std::vector<size_t>& candidates, const Survey& survey,
                                       const CellViewOptions& options);

// The faces of the block grouped by cell (x, y).
std::map<std::pair<int, int>, std::vector<uint32_t>> FacesOfCells(const CityBlock& block, const GroundPlane& ground);

// Sets the views of survey->cells (CellsOf the city), from survey->ground, survey->views and survey->up. A cell gets
// the views in which most of it is visible (area in pixels, occlusion tested by ray casting) at good resolution,
// balanced over directions, so that facades keep their oblique pairs. `whole`: the mesh of `city`, local frame.
// `scratch_folder` temporarily takes 4 bytes per vertex. Depends only on the mesh and the views, not on the tiling.
// CANCELLED if `control` is cancelled; errors as CityReader::Block.
Status ChooseViews(const MeshSpans& whole, const CityReader& city, const CellViewOptions& options,
                   const TaskControl& control, const std::string& scratch_folder, Survey* survey);

}  // namespace tessera
