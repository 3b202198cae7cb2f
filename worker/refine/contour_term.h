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

// What the side between two pixels does to a corner of the nearer face.
struct ContourPull {
  uint32_t vertex = 0;
  Eigen::Vector3f gradient;        // weighted, per metre
  Eigen::Vector3f root_curvature;  // its outer square is the curvature, per metre²
};

// One view's contours, by pixels. `labels`: one a face; -1 or 255: none. `map`: of `mesh` in `view`. A view without
// likelihoods has none. Safe to call concurrently.
std::vector<ContourPull> ContourPulls(const TriangleMesh& mesh, const std::vector<int32_t>& labels,
                                      const PhotoView& view, const FaceMap& map, const ContourOptions& options);

// Adds to each vertex the mean over the views that have it at a contour: the gradient, and a positive semidefinite
// curvature. `pulls`: of each view.
void AddContourPulls(const std::vector<std::vector<ContourPull>>& pulls, std::vector<Eigen::Vector3d>* gradient,
                     std::vector<Eigen::Matrix3d>* curvature);

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_CONTOUR_TERM_H_
