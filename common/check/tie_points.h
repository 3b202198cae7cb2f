// The 3D points of a camera model: whether its images and the mesh fit them.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/scene/scene.h"

namespace tessera {

struct CalibratedImages;

struct TiePointFigures {
  int64_t observations = 0;   // image points with a 3D point
  double median_px = 0;       // median reprojection error of the image points
  int64_t track_entries = 0;  // (3D point, image) pairs of the tracks
  double inside_share = 0;    // share of the pairs whose 3D point projects into the image
  int64_t dangling = 0;       // references to images or 3D points that do not exist
  // Median reprojection error of each image with enough image points, by its name without "./" or "\\". Infinite if
  // most points are behind the camera.
  std::map<std::string, double> images_px;
  // Names of images whose median error is far above that of the others: their poses are of another adjustment.
  std::vector<std::string> stale;
  // Medians over the points of their distance from the mesh: signed (positive: outside), and without sign.
  std::optional<double> above_mesh_m, from_mesh_m;
};

TiePointFigures MeasureTiePoints(const CalibratedImages& model);

// Adds above_mesh_m and from_mesh_m, of a sample of the points. `mesh`: local frame, at least one face.
void MeasurePointDistances(const CalibratedImages& model, const SceneDescription& scene, const TriangleMesh& mesh,
                           TiePointFigures* figures);

struct TiePointContext {
  bool mesh_fits = false;   // the images match through the mesh
  bool is_complete = true;  // the whole model was read, so that dangling references are its fault
  double gsd_m = 0;
};

// Adds errors and warnings about cameras, images or a mesh that do not fit the points.
void JudgeTiePoints(const SceneDescription& scene, const TiePointFigures& figures, const TiePointContext& context,
                    Faults* faults, Warnings* warnings);

}  // namespace tessera
