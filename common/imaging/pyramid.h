// Image pyramids.
#ifndef TESSERA_COMMON_IMAGING_PYRAMID_H_
#define TESSERA_COMMON_IMAGING_PYRAMID_H_

#include <vector>

#include "common/imaging/raster.h"

namespace tessera {

// `levels` images (fewer where one side has shrunk to one pixel), the first `image` itself, each next of half the width
// and height, rounded up, every channel averaged over the pixel's exact area. The camera of a level is
// PinholeCamera::Resized to its size. NaN means invalid: a pixel is NaN where any pixel under it is. The same result
// for any number of threads; may be called from any thread.
std::vector<FloatImage> BuildPyramid(FloatImage image, int levels);

// One step of it.
FloatImage HalfResolution(const FloatImage& image);

}  // namespace tessera

#endif  // TESSERA_COMMON_IMAGING_PYRAMID_H_
