// Undistortion of photographs and of likelihoods in their image frame.
#pragma once

#include "common/imaging/camera.h"
#include "common/imaging/raster.h"

namespace tessera {

// The rectangle of the distorted image from which `part` of the undistorted image is sampled; never empty.
ImagePart SourcePart(const LensModel& lens, const ImagePart& part);

// `part` of the undistorted image. `source` holds `source_part` of the distorted image (of lens.pinhole's size), which
// must contain SourcePart(lens, part). All channels are resampled bilinearly. Pixels outside the photograph, or beyond
// the radius where the lens polynomial stops growing, get `outside`. The whole image of a pinhole camera is returned
// unchanged. The result does not depend on how the image is divided into parts.
FloatImage UndistortPart(FloatImage source, const ImagePart& source_part, const LensModel& lens, const ImagePart& part,
                         float outside);

}  // namespace tessera
