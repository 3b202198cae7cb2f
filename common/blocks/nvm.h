// NVM files of VisualSFM, and those that COLMAP and OpenSfM write.
#pragma once

#include <optional>
#include <string>

#include "common/base/status.h"
#include "common/blocks/block.h"
#include "common/blocks/block_format.h"
#include "common/blocks/photograph_files.h"

namespace tessera {

bool IsNvm(const std::string& path);
ImportedBlock ReadNvm(const std::string& path, const BlockReadOptions& options, Faults* faults, Warnings* warnings);

// Parses the text of the NVM file `name`. Of its models, each with its own coordinate system, it reads the one of
// options.component or the one with most images. The block is read as COLMAP writes NVM; its readings are those of
// VisualSFM and OpenSfM. Calls `size_of` once for each image, for the principal point.
ImportedBlock ParseNvm(const std::string& text, const std::string& name, const PhotographSize& size_of,
                       const BlockReadOptions& options, Faults* faults);

// The lens of VisualSFM's distortion: the undistorted position is (1 + k r^2) times the distorted one, r the distance
// of the distorted position from the principal point over the focal length. That function has no inverse that is a
// polynomial; forward coefficients are fitted by least squares over the image: with as few of those of COLMAP's
// FULL_OPENCV (a polynomial over a polynomial of r^2) as give a residual of at most .01 pixels. None if all do not, or
// if the function folds over within the image.
std::optional<LensModel> LensOfInverseRadial(const PinholeCamera& pinhole, double k);

}  // namespace tessera
