// Writes the change report: changes.json, changes.geojson, changes.png.
//
// changes.json:
//   tessera_changes     1: version of this format
//     scene               name of the scene
//     coordinates         "scene": places and rings are x, y (and z) in the scene's own coordinates, metres
//     cell_m, gsd_m       side of the measured cells; ground sampling distance of the new images
//     measured_area_m2    ground seen by at least two new views, where the old surface is known
//     totals              per kind: {count, area_m2, volume_m3}
//     disagreement        between the new images and the old surface, over the measured area:
//       agreement, agreement_before       photo term: mean ZNCC of the new images on the new and on the old surface
//       heights, labels                   shares of the area where the height, or the class, differs as in a change
//       refined                           {heights, labels}: the same for the refined mesh; null if there is none
//     needs_mesh          number of areas that the refined mesh does not follow
//     areas               ordered by first cell, row by row:
//       id                from 1; as in changes.geojson
//       kind              built | demolished | grown | felled | label
//       area_m2           sum of its cells, without holes
//       place             [x, y, z], mean of its cells
//       lon_lat           [degrees, degrees] WGS 84; absent if the scene is not georeferenced
//       height_difference_m, volume_m3    new less old; volume 0 for label changes
//       label_before, label_after         names of classes, null if there is none
//       agreement, agreement_before       mean ZNCC of the new images on the new and on the old surface
//       followed          whether the refined mesh shows the change; false: a new coarse mesh is needed there; null:
//         no refined mesh
//       new_mesh          if not followed, the extent of the coarse mesh needed: {box, outdated_faces}: two corners
//         [x, y, z] around the area on both surfaces; number of faces of mesh.ply in it
//       rings             [[[x, y], ...], ...]: the outline, then its holes; the first corner is not repeated
//
// changes.geojson (RFC 7946): a FeatureCollection of Polygons with the properties id, kind, area_m2,
// height_difference_m, volume_m3, label_before, label_after, followed. Coordinates are WGS 84 longitude and latitude
// if the scene is georeferenced, else x and y of the scene in metres. The member "tessera_coordinates" is "wgs84" or
// "scene" accordingly.
//
// changes.png: plan of the area with an old surface, x to the right and y up. Old heights as grey relief, white where
// unknown, areas in the colour of their kind.
#pragma once

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
  const ChangeRaster& raster;     // the whole raster (MergeRasters)
  const std::vector<ChangeArea>& areas;
  double gsd_m = 0;
  EpochDisagreement disagreement = {};
};

std::string ChangesJson(const ChangeReport& report);
std::string ChangesGeoJson(const ChangeReport& report);
// At most `max_side_px` wide and high; an integer number of pixels per cell or of cells per pixel.
ByteImage DrawChanges(const ChangeReport& report, int max_side_px = 1600);

// Writes all three files into `folder`, which is created if missing.
Status WriteChangeReport(const ChangeReport& report, const std::string& folder);

}  // namespace tessera
