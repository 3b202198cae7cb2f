// Finds the photographs of a block on this machine, and names them in the scene.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/blocks/block.h"

namespace tessera {

struct PathReplacement {
  std::string from, to;  // the beginning of a path in the source, and what replaces it
};

// Reads "OLD=NEW", the value of --image-path. INVALID_ARGUMENT without '=' or with an empty part.
StatusOr<PathReplacement> ParsePathReplacement(const std::string& text);

struct ImageSearch {
  std::string source;                // the block's file or folder, as the user gave it
  std::vector<std::string> folders;  // --images: where to search; empty: beside the source
  std::vector<PathReplacement> replacements;
};

struct FoundImage {
  std::string file;  // absolute; empty if the image is missing
  std::string name;  // below the scene's images folder: the shortest end of its path that no other image has
};

// The file of each image of the block: its path after a replacement, or as it is, if there is such a file; else the
// file in the searched folders whose path has the longest common end with the image's path, in whole names, ignoring
// case. Only oriented images are searched; others get no file. Adds a fault for each missing image, for an image with
// several files of equal right and for a file of several images; if images are missing, a last one says which options
// would find most of them.
std::vector<FoundImage> FindImages(const std::vector<BlockImage>& images, const ImageSearch& search, Faults* faults);

}  // namespace tessera
