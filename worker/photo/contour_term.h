// E_contour: occluding contours go to the edges of the images that the class likelihoods name.
#ifndef TESSERA_WORKER_PHOTO_CONTOUR_TERM_H_
#define TESSERA_WORKER_PHOTO_CONTOUR_TERM_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/imaging/border_trust.h"
#include "worker/photo/photo_term.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Two pixels side by side make a contour where one lies deeper than the other by more than the gap and both have
// labels, different ones. Across each such side the edge that the likelihoods name is sought (MeasureContour), and
// pulls the nearer surface along the line across the side by w d: d pixels to the edge, at most kMaxPull_px, w what the
// measurement is worth. This is a spring to the edge as it was found and not the derivative of an energy of labels:
// likelihoods as such (Gargallo et al. 2007) would put a contour wherever a classifier errs, in all views alike. Terms
// between views do not have it, so crowns, eaves and roofs that start too small would stay too small.
struct ContourOptions {
  double weight = 0;          // λ4, beside the photo energy of a pixel
  double gap_px = 4;          // of depth, in pixels at the nearer depth
  BorderTrusts borders = {};  // of the likelihoods, pixels of level 0
  int level = 0;              // of the pyramid
};

// What contours do to the corners of a face that ends at them.
struct FaceContour {
  uint32_t face = 0;
  std::array<Eigen::Vector3d, 3> gradient;               // a corner: weighted, per metre
  std::array<Eigen::Matrix<double, 6, 1>, 3> curvature;  // the same, per metre²: xx, xy, xz, yy, yz, zz
  uint32_t views_begin = 0, views_end = 0;               // of ContourSums::views: those that have it at a contour

  Eigen::Matrix3d Curvature(int corner) const;
};

// By rising face.
struct ContourSums {
  std::vector<FaceContour> faces;
  std::vector<int32_t> views;  // the job's numbers
};

// One view's contours, by faces. `labels`: one a face; -1 or 255: none. `map`: of `mesh` in `view`, of which the pixels
// of own faces (flags in `own`; empty: all) and those beside them are read. A view without likelihoods has none. Safe
// to call concurrently.
std::vector<FaceContour> FindContours(const TriangleMesh& mesh, const std::vector<int32_t>& labels,
                                      const std::vector<uint8_t>& own, const PhotoView& view, const FaceMap& map,
                                      const ContourOptions& options);

// Views in their order. `view_ids`: the job's number of each.
ContourSums AddContours(const std::vector<std::vector<FaceContour>>& views, const std::vector<int32_t>& view_ids);

}  // namespace tessera

#endif  // TESSERA_WORKER_PHOTO_CONTOUR_TERM_H_
