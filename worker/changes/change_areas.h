// Where a city changed: connected areas of cells, with their outlines and figures.
#ifndef TESSERA_WORKER_CHANGES_CHANGE_AREAS_H_
#define TESSERA_WORKER_CHANGES_CHANGE_AREAS_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/scene/scene.h"
#include "worker/changes/change_raster.h"
#include "worker/changes/outline.h"

namespace tessera {

enum class ChangeKind {
  kBuilt,       // higher, and no vegetation now
  kDemolished,  // lower, and no vegetation before
  kGrown,       // higher, vegetation now
  kFelled,      // lower, vegetation before
  kLabel,       // of equal height, another class
};
inline constexpr std::array kChangeKinds = {ChangeKind::kBuilt, ChangeKind::kDemolished, ChangeKind::kGrown,
                                            ChangeKind::kFelled, ChangeKind::kLabel};
// "built", "demolished", "grown", "felled", "label".
const char* ChangeKindName(ChangeKind kind);

// What a class is to changes.
enum class ClassRole { kGround, kBuilding, kVegetation, kOther };
// By the names that scene.json knows: ground, facade and roof, vegetation.
std::vector<ClassRole> ClassRoles(const std::vector<SceneClass>& classes);

struct ChangeArea {
  ChangeKind kind = ChangeKind::kBuilt;
  Outline outline;  // metres in the ground plane, local frame
  double area_m2 = 0;
  Eigen::Vector3d place = Eigen::Vector3d::Zero();  // mean of its cells: x and y in the plane, new height
  double height_difference_m = 0;                   // mean of new less old
  double volume_m3 = 0;                             // area times height difference: negative where something went
  uint8_t label_before = kNoLabel, label_after = kNoLabel;  // of most cells
  double agreement = 0;          // of the new images on the new surface, mean (ChangeRaster::after_score)
  double agreement_before = 0;   // the same on the old surface
  std::optional<bool> followed;  // whether the refined mesh has it; nothing: not asked
  std::vector<Eigen::Vector2i> cells;
  double low_m = 0, high_m = 0;  // coordinates along the plane's up between which both surfaces lie
  int64_t outdated_faces = 0;    // of the refined mesh, where it does not follow; counted by the changes task
};

struct ChangeAreaOptions {
  double height_m = 1.5, height_gsd = 6;  // a cell's height differs by more than the larger of these,
  double weak_share = 0.6;                // or by this share of it beside such a cell
  double label_margin = 0.2;              // a cell's class differs by more than this
  double min_area_m2 = 25;
  double min_label_area_m2 = 25;
  double min_width_m = 3, min_width_cells = 2;
  double min_agreement = 0.4;        // mean of the new images on the new surface,
  double min_agreement_gain = 0.25;  // and that much more than on the old one; of areas of equal height at least
  double min_label_agreement = 0.5;
  double followed_share = 0.7;   // of an area's cells that the refined mesh has right
  double simplify_cells = 0.75;  // outlines stay so near to the cells' border
};

// By how much heights differ for good at this ground sampling distance.
double HeightThreshold_m(const ChangeAreaOptions& options, double gsd_m);

// Whether labels, both of a class, stand for different things: from above a roof may show its eaves' facade.
bool ClassesDiffer(const std::vector<ClassRole>& roles, uint8_t a, uint8_t b);

// `rasters`: of one plane and cell size, of any number of tiles, in any order; cells that several have count as the
// last one has them. `refined`: what the refined mesh of the update shows (DrawSurface), or empty. Areas come by their
// first cell, row by row. Memory: 20 bytes a cell of the rectangle around all.
std::vector<ChangeArea> FindChangeAreas(std::span<const ChangeRaster> rasters, std::span<const SurfaceRaster> refined,
                                        const std::vector<ClassRole>& roles, double gsd_m,
                                        const ChangeAreaOptions& options);

// One raster of all cells of the rectangle around `rasters`.
ChangeRaster MergeRasters(std::span<const ChangeRaster> rasters);
// What of `rasters` lies in `cells`.
SurfaceRaster MergeSurfaces(std::span<const SurfaceRaster> rasters, const CellRect& cells, double cell_m);

}  // namespace tessera

#endif  // TESSERA_WORKER_CHANGES_CHANGE_AREAS_H_
