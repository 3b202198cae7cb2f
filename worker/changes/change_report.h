// The report of changes: changes.json, changes.geojson, changes.png.
//
// changes.json:
//   tessera_changes     1: the version of this layout
//   scene               name of the scene
//   coordinates         "scene": places and rings are x, y (and z) in the scene's own coordinates, metres
//   cell_m, gsd_m       side of the cells measured; ground sampling distance of the new images
//   measured_area_m2    ground that at least two new views see, and of which the old surface is known
//   totals              a kind: {count, area_m2, volume_m3}
//   disagreement        of the new images with the surface that the earlier ones left, over the measured area:
//     agreement, agreement_before       photo term: mean ZNCC of the new images on the new and on the old surface
//     heights, labels                   shares of the area that differ: in height by as much as changes do; in class
//     refined                           {heights, labels}: the same with the result in the old surface's place; null
//                                       if none was compared
//   needs_mesh          how many areas the refined mesh does not follow
//   areas               by their first cell, row by row:
//     id                from 1 on; the same as in changes.geojson
//     kind              built | demolished | grown | felled | label
//     area_m2           of its cells, holes not counted
//     place             [x, y, z], mean of its cells
//     lon_lat           [degrees, degrees] WGS 84; absent for local scenes
//     height_difference_m, volume_m3    new less old; 0 volume where only the label changed
//     label_before, label_after         names of classes, null where there is none
//     agreement, agreement_before       mean ZNCC of the new images on the new and on the old surface
//     followed          whether the refined mesh follows the change; false: a new coarse mesh is needed there; null: no
//                       refined mesh was compared
//     new_mesh          where not followed, what a new coarse mesh has to cover: {box, outdated_faces}: two corners
//                       [x, y, z] around the area on the old and the new surface; faces of mesh.ply that lie there
//     rings             [[[x, y], ...], ...]: the outline, then its holes; first corners not repeated
//
// changes.geojson (RFC 7946): a FeatureCollection of Polygons with the properties id, kind, area_m2,
// height_difference_m, volume_m3, label_before, label_after, followed. WGS 84 longitude and latitude where the scene
// has a place on Earth; else x and y of the scene, metres. The member "tessera_coordinates" says which: "wgs84" or
// "scene".
//
// changes.png: the plan where there is an old surface, x to the right and y up; its heights as grey relief, white
// elsewhere, areas in the colour of their kind.
#ifndef TESSERA_WORKER_CHANGES_CHANGE_REPORT_H_
#define TESSERA_WORKER_CHANGES_CHANGE_REPORT_H_

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/raster.h"
#include "common/job/ground.h"
#include "common/scene/scene.h"
#include "worker/changes/change_areas.h"
#include "worker/changes/change_raster.h"
#include "worker/changes/disagreement.h"

namespace tessera {

struct ChangeReport {
  const SceneDescription& scene;  // name, classes, frame
  const GroundPlane& ground;      // of the raster
  const ChangeRaster& raster;     // all of it (MergeRasters)
  const std::vector<ChangeArea>& areas;
  double gsd_m = 0;
  EpochDisagreement disagreement = {};
};

std::string ChangesJson(const ChangeReport& report);
std::string ChangesGeoJson(const ChangeReport& report);
// At most `max_side_px` wide and high, a whole number of pixels a cell or of cells a pixel.
ByteImage DrawChanges(const ChangeReport& report, int max_side_px = 1600);

// All three, into `folder` (made if missing).
Status WriteChangeReport(const ChangeReport& report, const std::string& folder);

}  // namespace tessera

#endif  // TESSERA_WORKER_CHANGES_CHANGE_REPORT_H_
