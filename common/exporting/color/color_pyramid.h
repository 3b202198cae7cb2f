// The colours of a part of a photograph, on pyramid levels.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/image_io.h"

namespace tessera {

// Level l halves the undistorted image l times, by the mean of 2 x 2 pixels that are counted from its top left corner.
// So colours do not depend on the part. A pixel with a masked pixel below it is masked. Thread-safe.
class ColorPyramid {
 public:
  // Reads what positions in `part` need on the levels 0 to `highest_level`. `part` is not empty and inside the image.
  // Errors as ReadColorPart.
  static StatusOr<ColorPyramid> Read(const std::string& path, const LensModel& lens, const ImagePart& part,
                                     int highest_level, const PhotographOptions& options);

  // Red, green and blue in [0, 1] at a position of the undistorted image, in pixels of level 0; bilinear between the
  // pixels of `level`. NaN at masked pixels and outside the photograph.
  Eigen::Vector3f At(double x, double y, int level) const;

 private:
  struct Level {
    FloatImage pixels;
    int x0 = 0, y0 = 0;                     // of the first pixel in the whole level
    int whole_width = 0, whole_height = 0;  // of the level
  };
  static Level Halved(const Level& level);

  std::vector<Level> levels_;
};

}  // namespace tessera
