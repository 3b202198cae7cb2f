// E_contour: what the classes say about occluding contours, where the nearer surface should end in each image.
#ifndef TESSERA_WORKER_REFINE_CONTOUR_TERM_H_
#define TESSERA_WORKER_REFINE_CONTOUR_TERM_H_

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/geometry/mesh.h"
#include "worker/refine/photo_term.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// E = Σ over views and pixels of 1 - L(label of the face seen). This is its derivative by the silhouettes (after
// Gargallo et al. 2007): a contour that moves by a pixel shows the label in front where it showed the label behind.
// Terms between views do not have it, so crowns, eaves and roofs that start too small would stay too small. Two pixels
// side by side make a contour where one lies deeper than the other by more than the gap and both have labels, different
// ones.
struct ContourOptions {
  double weight = 0;  // λ4, beside the photo energy of a pixel
  double gap_px = 4;  // of depth, in pixels at the nearer depth
  // Metres across `up` from the nearer point to the one behind it; what lies farther off makes no contour. So no vertex
  // asks about surfaces that its tile's halo does not hold.
  double reach_m = std::numeric_limits<double>::infinity();
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
};

// Adds the weighted gradient (per metre) and a positive semidefinite curvature (per metre²) to the corners of the
// nearer faces: each vertex's mean over the views that have it at a contour. `labels`: one a face; -1 or 255: none.
// `maps`: of `mesh` in `views`; views without likelihoods are left out. Results do not depend on the number of threads.
void AddContourTerm(const TriangleMesh& mesh, const std::vector<int32_t>& labels, const std::vector<PhotoView>& views,
                    const std::vector<FaceMap>& maps, const ContourOptions& options,
                    std::vector<Eigen::Vector3d>* gradient, std::vector<Eigen::Matrix3d>* curvature);

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_CONTOUR_TERM_H_
