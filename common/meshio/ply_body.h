// Readers of a PLY file's elements, after its header.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/meshio/byte_source.h"
#include "common/meshio/ply.h"
#include "common/meshio/ply_header.h"

namespace tessera {

// Both read all elements declared in `header` from `source`, which is positioned after the header, into `sink`.
// INVALID_ARGUMENT with the line or byte offset; also for data after the last element.
Status ReadPlyText(ByteSource& source, const PlyHeader& header, const std::string& name, MeshSink& sink);
Status ReadPlyBinary(ByteSource& source, const PlyHeader& header, const std::string& name, MeshSink& sink);

}  // namespace tessera
