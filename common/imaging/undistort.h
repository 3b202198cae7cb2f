// Undistortion of photographs and of what shares their frame.
#ifndef TESSERA_COMMON_IMAGING_UNDISTORT_H_
#define TESSERA_COMMON_IMAGING_UNDISTORT_H_

#include "common/imaging/camera.h"
#include "common/imaging/raster.h"

namespace tessera {

// `distorted` (of lens.pinhole's size) resampled bilinearly onto lens.pinhole, all channels alike; pixels that the
// photograph does not show get `outside`. A pinhole's image comes back untouched. Beyond the radius where a lens
// polynomial folds back, nothing is shown.
FloatImage Undistort(FloatImage distorted, const LensModel& lens, float outside);

// The part of the distorted image that the undistorted image's `part` is sampled from; never empty.
ImagePart SourcePart(const LensModel& lens, const ImagePart& part);

// The undistorted image's `part`, byte for byte, from the distorted image's `source_part` (SourcePart's, or more).
FloatImage UndistortPart(FloatImage source, const ImagePart& source_part, const LensModel& lens, const ImagePart& part,
                         float outside);

}  // namespace tessera

#endif  // TESSERA_COMMON_IMAGING_UNDISTORT_H_
