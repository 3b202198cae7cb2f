// Undistortion of photographs and of likelihoods in their image frame.
#ifndef TESSERA_COMMON_IMAGING_UNDISTORT_H_
#define TESSERA_COMMON_IMAGING_UNDISTORT_H_

#include "common/imaging/camera.h"
#include "common/imaging/raster.h"

namespace tessera {

// Resamples all channels of `distorted` (of lens.pinhole's size) bilinearly onto lens.pinhole. Pixels outside the
// photograph, or beyond the radius where the lens polynomial stops growing, get `outside`. Images of a pinhole camera
// are returned unchanged.
FloatImage Undistort(FloatImage distorted, const LensModel& lens, float outside);

// The rectangle of the distorted image from which `part` of the undistorted image is sampled; never empty.
ImagePart SourcePart(const LensModel& lens, const ImagePart& part);

// `part` of the undistorted image, bit-identical to that part of Undistort's result. `source` holds `source_part` of
// the distorted image, which must contain SourcePart(lens, part).
FloatImage UndistortPart(FloatImage source, const ImagePart& source_part, const LensModel& lens, const ImagePart& part,
                         float outside);

}  // namespace tessera

#endif  // TESSERA_COMMON_IMAGING_UNDISTORT_H_
