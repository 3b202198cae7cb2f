// OpenMVS: scenes in the interface format, MVSI versions 1 to 7 (libs/MVS/Interface.h of OpenMVS).
#pragma once

#include <string>
#include <string_view>

#include "common/blocks/block_format.h"
#include "common/imaging/image_io.h"

namespace tessera {

// Whether `path` is a file of OpenMVS, also a project (MVS), which ReadOpenMvs refuses.
bool IsOpenMvs(const std::string& path);

// Reads the cameras and poses of an interface file. Its points name their images without positions in them, so they are
// left out. Cameras without an image size take it from the images.
ImportedBlock ReadOpenMvs(const std::string& path, const BlockReadOptions& options, Faults* faults, Warnings* warnings);

// The same from the file's content, for tests and fuzzing. `file`: the path for messages. `image_size`: the size of the
// image of this name; called for cameras without one.
ImportedBlock ParseOpenMvs(std::string_view bytes, const std::string& file, const PhotographSize& image_size,
                           Faults* faults);

}  // namespace tessera
