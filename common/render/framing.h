// Cameras that show a whole mesh, and zoom into a part of an image.
#pragma once

#include <Eigen/Core>

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"

namespace tessera {

// A camera above the mesh that looks straight down, with the second horizontal axis (north) up in the image. Its angle
// of view is narrow (10 degrees), so that facades are hardly visible. All vertices of faces project into the image.
// `mesh`: metric frame, at least one face. `up`: unit vector.
PosedCamera NadirCamera(const TriangleMesh& mesh, const Eigen::Vector3d& up, int width_px, int height_px);

// An oblique camera: its direction of view is `azimuth_rad` (clockwise from the second horizontal axis, so pi/4 is
// north-east) and `pitch_rad` below the horizon; angle of view 30 degrees.
PosedCamera ObliqueCamera(const TriangleMesh& mesh, const Eigen::Vector3d& up, double azimuth_rad, double pitch_rad,
                          int width_px, int height_px);

// Enlarges the part of the image centred at (x, y) to the whole image. x, y and the size `share` of the part are
// fractions of the image's width and height.
PinholeCamera Zoomed(const PinholeCamera& camera, double x, double y, double share);

}  // namespace tessera
