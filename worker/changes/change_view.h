// The new flight's views as the measuring of changes takes them.
#ifndef TESSERA_WORKER_CHANGES_CHANGE_VIEW_H_
#define TESSERA_WORKER_CHANGES_CHANGE_VIEW_H_

#include <Eigen/Geometry>
#include <array>
#include <vector>

#include "common/imaging/camera.h"
#include "common/imaging/raster.h"
#include "common/tile/ground.h"

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

struct ViewChoiceOptions {
  int max_views = 7;
  int max_pairs = 14;
  double near_nadir_rad = 0.70;  // views tilted more are taken only where there are too few
  double max_tilt_rad = 1.05;
  int few_views = 4;
  double min_base_to_height = 0.08;
};

// The views that see the middle of `block` (plan metres, local frame) at `height_m` and look down at it most steeply,
// and the pairs of them with the most parallax that windows on the ground still bear. Depends on nothing else, so that
// a tile may load the views that its blocks choose. `cameras`: of whole images. Fewer than two views: no pairs.
ViewChoice ChooseViews(const std::vector<PosedCamera>& cameras, const GroundPlane& ground,
                       const Eigen::AlignedBox2d& block, double height_m, const ViewChoiceOptions& options);

}  // namespace tessera

#endif  // TESSERA_WORKER_CHANGES_CHANGE_VIEW_H_
