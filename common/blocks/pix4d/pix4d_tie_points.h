// Tie points of Pix4D, triangulated.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/blocks/block.h"

namespace tessera {

// Parses the text of the file tp_pix4d.txt called `name` and adds its points to `block`, which has cameras and images.
// The file states no positions in space: each is the one with the least squares of distances in undistorted images.
// Points in one image or with nearly parallel rays are left out.
void ParsePix4dTiePoints(const std::string& text, const std::string& name, ImportedBlock* block, Faults* faults);

}  // namespace tessera
