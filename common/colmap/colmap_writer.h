// Writing of COLMAP text models.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/colmap/calibrated_images.h"

namespace tessera {

// Writes cameras.txt, images.txt and points3D.txt to `folder`, which exists and has none of them. Numbers have as many
// digits as they need to be read as the same doubles. A camera gets the simplest model of COLMAP that has its
// coefficients: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV or FULL_OPENCV; TESSERA_BROWN only for k4 or
// skew of LensModel::kBrown. Tracks are made from the observations of the images, not from TiePoint::image_ids; points
// are grey, without an error. Memory beside the model: some 50 bytes a point and 8 bytes an observation.
// INVALID_ARGUMENT if the name of an image cannot stand in a line of text, or an observation has no point; file errors.
Status WriteColmapModel(const CalibratedImages& model, const std::string& folder);

}  // namespace tessera
