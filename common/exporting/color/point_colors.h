// Colours of surface points from photographs.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/sheet.h"
#include "common/geometry/mesh.h"
#include "common/scene/scene.h"

namespace tessera {

struct PointColorInput {
  std::span<const Eigen::Vector3d> points;   // metres, local frame
  std::span<const Eigen::Vector3f> normals;  // per point: unit vector, or zero: seen from all sides
  std::span<const MeshSpans> occluders;      // surfaces that may hide points; the points lie on them
  std::span<const SceneView> views;          // that may show the points
  std::span<const std::string> view_files;   // path of the photograph per view; empty: the view is not used
  std::span<const std::string> mask_files;   // path of the mask per view, empty: none; or no elements
  std::span<const float> spacing_m = {};  // per point: distance to its neighbours; photographs are averaged to pixels
                                          // of at most half of it (pyramid levels). No elements: they are not
  int views_per_point = 5;
};

// The colour of a point is the median, per channel, over the `views_per_point` views that see it best. Views see a
// point if it projects into the image, its normal is less than 80 degrees from the direction to the camera, and no
// occluder lies between, with a tolerance of two GSD. The best have the most pixels for an area on the surface: f^2 /
// z^2 times the cosine of that angle, falling to 0 at the rim of the image. The median is weighted by the same number,
// so that colours do not jump where a view ends. Masked pixels are as if the view did not see the point.
//
// `seen`: per point, how many views gave its colour; 0: none, the colour is black. Memory: a part of one photograph,
// the occluders as Embree holds them, about 140 bytes a point (twice as much with masks). The result does not depend on
// the order of the views, which have different names, nor on the number of threads. INVALID_ARGUMENT for sizes that
// differ; errors as ReadColorPart; CANCELLED.
Status ColorPoints(const PointColorInput& input, std::vector<Rgb>* colors, std::vector<uint8_t>* seen,
                   const TaskControl& control);

}  // namespace tessera
