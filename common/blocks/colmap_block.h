// COLMAP sparse models as blocks; common/colmap reads them.
#pragma once

#include <string>

#include "common/blocks/block_format.h"

namespace tessera {

// Whether `path` is a folder with a sparse model, or with models in 0, 1, ..., sparse, sparse/0, sparse/1, ...
bool IsColmapBlock(const std::string& path);

// Reads the model of options.component (a folder N or sparse/N), or that of ReadColmapModel. Points keep the image
// points of their tracks that name them.
ImportedBlock ReadColmapBlock(const std::string& path, const BlockReadOptions& options, Faults* faults,
                              Warnings* warnings);

}  // namespace tessera
