// The new flight's views as the measuring of changes takes them.
#ifndef TESSERA_WORKER_CHANGES_CHANGE_VIEW_H_
#define TESSERA_WORKER_CHANGES_CHANGE_VIEW_H_

#include <Eigen/Geometry>
#include <array>
#include <vector>

#include "common/imaging/camera.h"
#include "common/imaging/raster.h"
#include "common/job/ground.h"

namespace tessera {

// Pixels at hand of a view: all of its image, or a window of it.
struct ChangeView {
  PosedCamera camera;          // undistorted, of the whole image; local frame
  FloatImage luminance;        // NaN: not shown
  int x0 = 0, y0 = 0;          // of the first pixel at hand in the whole image
  FloatImage likelihoods;      // a plane a class, any resolution; empty: none
  PixelMapping likelihood_at;  // from the whole image's pixels to those of `likelihoods`
};

// Which views a block is measured from, and how finely.
struct ViewChoice {
  std::vector<int> views;                 // ascending
  std::vector<std::array<int, 2>> pairs;  // indices into `views`
  double base_to_height = 0;              // of the widest pair: its parallax in the plane a metre of height
};

struct BlockViewOptions {
  int views_per_place = 4;  // that each place of a block is measured from, if so many see it
  int pairs_per_place = 5;
  int max_views = 14, max_pairs = 30;  // of a block
  double near_nadir_rad = 0.60;        // views tilted more are taken only where a block has no others
  double max_tilt_rad = 1.05;
  double min_base_to_height = 0.08;
};

// Views are chosen for places of `block` (plan metres, local frame) on a grid, at `height_m`: at each those that look
// down most steeply; then the pairs of them with the most parallax that windows on the ground still bear. Depends on
// nothing else, so that a tile may load the views that its blocks choose. `cameras`: of whole images. Fewer than two
// views: no pairs.
ViewChoice ChooseViews(const std::vector<PosedCamera>& cameras, const GroundPlane& ground,
                       const Eigen::AlignedBox2d& block, double height_m, const BlockViewOptions& options);

}  // namespace tessera

#endif  // TESSERA_WORKER_CHANGES_CHANGE_VIEW_H_
