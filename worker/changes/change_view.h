// Views of the new flight as input of change measurement.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <vector>

#include "common/imaging/camera.h"
#include "common/imaging/raster.h"
#include "common/job/ground.h"

namespace tessera {

// The loaded pixels of a view: the whole image or a window of it.
struct ChangeView {
  PosedCamera camera;          // undistorted, of the whole image; local frame
  FloatImage luminance;        // NaN: no data
  int x0 = 0, y0 = 0;          // position of the first loaded pixel in the whole image
  bool masked = false;         // likelihoods count only where luminance has data
  FloatImage likelihoods;      // one plane per class, any resolution; empty: none
  PixelMapping likelihood_at;  // from the whole image's pixels to pixels of `likelihoods`
};

// The views and pairs from which a block is measured.
struct ViewChoice {
  std::vector<int> views;                 // ascending
  std::vector<std::array<int, 2>> pairs;  // indices into `views`
  double base_to_height = 0;              // of the widest pair: parallax in the plane per metre of height
};

struct BlockViewOptions {
  int views_per_place = 4;  // views that measure each point of a block, if as many see it
  int pairs_per_place = 5;
};

// Selects views for `block` (plan metres, local frame): the most vertical ones at each point of a grid at height
// `height_m`, then the pairs of these with the best parallax for matching windows on the ground. `cameras`: of whole
// images. The result depends only on the arguments, so that a tile can load exactly the views that its blocks use.
// With fewer than two views there are no pairs.
ViewChoice ChooseViews(const std::vector<PosedCamera>& cameras, const GroundPlane& ground,
                       const Eigen::AlignedBox2d& block, double height_m, const BlockViewOptions& options);

}  // namespace tessera
