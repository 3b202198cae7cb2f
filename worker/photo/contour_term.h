// E_contour: pulls occluding contours towards the image edges selected by the class likelihoods.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "common/base/loops/uninitialized_vector.h"
#include "common/geometry/mesh.h"
#include "common/imaging/border_trust.h"
#include "worker/photo/photo_term.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Two adjacent pixels form a contour if their depths differ by more than the gap and they have different labels. For
// each such pair MeasureContour searches the image edge across it. The nearer surface is then pulled along that
// direction with force w d: d is the distance to the edge in pixels, at most kMaxPull_px, and w the weight of the
// measurement.
// This is a spring to the measured edge, not the gradient of a label energy: likelihoods alone (Gargallo et al. 2007)
// would move contours to the classifier's systematic errors, which are equal in all views. Terms between views cannot
// correct contours, so without E_contour tree crowns, eaves and roofs that start too small would stay too small.
struct ContourOptions {
  double weight = 0;          // λ4, relative to the photo energy of a pixel
  double gap_px = 4;          // depth gap, in units of the pixel size at the nearer depth
  BorderTrusts borders = {};  // of the likelihoods, in pixels of level 0
  int level = 0;              // pyramid level
};

// Derivatives of E_contour at the corners of a face on a contour.
struct FaceContour {
  uint32_t face = 0;
  std::array<Eigen::Vector3d, 3> gradient;               // per corner: weighted, per metre
  std::array<Eigen::Matrix<double, 6, 1>, 3> curvature;  // per corner, per metre²: xx, xy, xz, yy, yz, zz
  uint32_t views_begin = 0, views_end = 0;  // range of ContourSums::views: views with this face on a contour

  Eigen::Matrix3d Curvature(int corner) const;
};

// Sorted by face.
struct ContourSums {
  UninitializedVector<FaceContour> faces;
  std::vector<int32_t> views;  // the job's view ids

  // Appends a contour of other sums, with its views, as that of `face`.
  void Append(uint32_t face, const FaceContour& contour, const std::vector<int32_t>& its_views);
};

// Contours of one view. `labels`: one per face; -1 or 255: none. `map`: of `mesh` in `view`; the pixels of own faces
// (flags in `own`; empty: all) and those next to them are read. A view without likelihoods has no contours.
// Thread-safe.
std::vector<FaceContour> FindContours(const TriangleMesh& mesh, const std::vector<int32_t>& labels,
                                      const std::vector<uint8_t>& own, const PhotoView& view, const FaceMap& map,
                                      const ContourOptions& options);

// Sums the views in their order; the contours of each ascend in their faces. `view_ids`: the job's id of each.
ContourSums AddContours(const std::vector<std::vector<FaceContour>>& views, const std::vector<int32_t>& view_ids);

}  // namespace tessera
