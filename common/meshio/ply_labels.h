// The property of a PLY file that holds the labels.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/meshio/mesh_content.h"
#include "common/meshio/ply_header.h"

namespace tessera {

// Gives a property the role kLabel and fills the header's fields on labels: options.label_property, or, if that is
// none, the one called `label`, else the only one with a name that other programs use; of faces, else of vertices. An
// empty name means no labels. INVALID_ARGUMENT with `name` (the file's name) if the named property does not exist or is
// no number, or if several could be meant.
Status ChoosePlyLabels(const std::string& name, const MeshReadOptions& options, PlyHeader* header);

}  // namespace tessera
