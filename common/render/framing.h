// Cameras that show a whole mesh, or a part of a picture larger.
#ifndef TESSERA_COMMON_RENDER_FRAMING_H_
#define TESSERA_COMMON_RENDER_FRAMING_H_

#include <Eigen/Core>

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"

namespace tessera {

// A camera from straight above, the second horizontal axis (north) up in the picture, with a narrow angle of view (10
// degrees) so that facades hardly show. All vertices of faces lie in the picture. `mesh` in a metric frame, at least
// one face; `up` unit.
PosedCamera NadirCamera(const TriangleMesh& mesh, const Eigen::Vector3d& up, int width_px, int height_px);

// The same from the side: looking along `azimuth_rad` (clockwise from the second horizontal axis, so pi/4 looks
// north-east), `pitch_rad` below the horizon, 30 degrees of view.
PosedCamera ObliqueCamera(const TriangleMesh& mesh, const Eigen::Vector3d& up, double azimuth_rad, double pitch_rad,
                          int width_px, int height_px);

// The part of the picture centred at (x, y) and `share` as wide, all in shares of the picture's width and height,
// filling the same number of pixels.
PinholeCamera Zoomed(const PinholeCamera& camera, double x, double y, double share);

}  // namespace tessera

#endif  // TESSERA_COMMON_RENDER_FRAMING_H_
