// Finds the photographs of a block on this machine, and names them in the scene.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/blocks/block.h"
#include "common/blocks/photograph_files.h"

namespace tessera {

struct FoundImage {
  std::string file;  // absolute; empty if the image is missing
  std::string name;  // below the scene's images folder: the shortest end of its path that no other image has
};

// The file of each image of the block, by PhotographFiles. Only oriented images are searched; others get no file. Adds
// a fault for each missing image, for an image with several files of equal right and for a file of several images. If
// images are missing, also block.missing_images, a last one says which options would find most of them. `source`: the
// block's file or folder, as the user gave it.
std::vector<FoundImage> FindImages(const ImportedBlock& block, const std::string& source,
                                   const PhotographSearch& search, Faults* faults);

}  // namespace tessera
