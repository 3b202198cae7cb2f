// Changed areas of a city: connected cells with outline and statistics.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/job/change_kind.h"
#include "common/scene/scene.h"
#include "worker/changes/change_raster.h"
#include "worker/changes/outline.h"

namespace tessera {

// Role of a class in change detection.
enum class ClassRole { kGround, kBuilding, kVegetation, kOther };
// By the class names of scene.json: "ground"; "facade", "roof"; "vegetation"; all others are kOther.
std::vector<ClassRole> ClassRoles(const std::vector<SceneClass>& classes);

struct ChangeArea {
  ChangeKind kind = ChangeKind::kBuilt;
  Outline outline;  // metres in the ground plane, local frame
  double area_m2 = 0;
  Eigen::Vector3d place = Eigen::Vector3d::Zero();          // mean of its cells; z: new height
  double height_difference_m = 0;                           // mean of new less old
  double volume_m3 = 0;                                     // area times height difference; negative if lower
  uint8_t label_before = kNoLabel, label_after = kNoLabel;  // most frequent over the cells
  double agreement = 0;          // mean agreement of the new images on the new surface (ChangeRaster::after_score)
  double agreement_before = 0;   // the same on the old surface
  std::optional<bool> followed;  // whether the refined mesh shows the change; nullopt: no refined mesh given
  std::vector<Eigen::Vector2i> cells;
  double low_m = 0, high_m = 0;  // height range of both surfaces, along the plane's up
  int64_t outdated_faces = 0;    // of the refined mesh if it does not follow; set by the changes task
};

struct ChangeAreaOptions {
  double height_m = 1.5, height_gsd = 6;  // threshold: the larger of both
  double label_margin = 0.2;              // minimum for a change of class
  double min_area_m2 = 25;
  double min_label_area_m2 = 25;
  double min_width_m = 3, min_width_cells = 2;
  double min_agreement = 0.4;        // minimum ChangeArea::agreement, and
  double min_agreement_gain = 0.25;  // gain over agreement_before; not for changes of class
  double simplify_cells = 0.75;      // tolerance of SimplifyRing
};

// Smallest height difference that counts as a change at this ground sampling distance.
double HeightThreshold_m(const ChangeAreaOptions& options, double gsd_m);

// Whether two labels differ in role. Roof and facade do not: from above, a roof may show its eaves' facade.
bool ClassesDiffer(const std::vector<ClassRole>& roles, uint8_t a, uint8_t b);

// Finds the changed areas of `rasters`: any number of tiles of one plane and cell size, in any order. If tiles
// overlap, the last one counts. `refined`: rasters of the update's refined mesh (DrawSurface), or empty. Areas are
// ordered by their first cell, row by row. Memory: 20 bytes per cell of the bounding rectangle.
std::vector<ChangeArea> FindChangeAreas(std::span<const ChangeRaster> rasters, std::span<const SurfaceRaster> refined,
                                        const std::vector<ClassRole>& roles, double gsd_m,
                                        const ChangeAreaOptions& options);

// Copies all rasters into one that covers their bounding rectangle.
ChangeRaster MergeRasters(std::span<const ChangeRaster> rasters);
// Copies the parts of `rasters` that lie in `cells`.
SurfaceRaster MergeSurfaces(std::span<const SurfaceRaster> rasters, const CellRect& cells, double cell_m);

}  // namespace tessera
