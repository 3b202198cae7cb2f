// Readers of a PLY file's elements, after its header.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/meshio/byte_source.h"
#include "common/meshio/mesh_content.h"
#include "common/meshio/ply_header.h"

namespace tessera {

// Both read all elements declared in `header` from `source`, which is positioned after the header, into `sink`.
// INVALID_ARGUMENT with the line or byte offset; also for data after the last element. Warn of faces that were split
// and of a few bytes after the last element.
Status ReadPlyText(ByteSource& source, const PlyHeader& header, const std::string& name, const MeshReadOptions& options,
                   MeshSink& sink);
Status ReadPlyBinary(ByteSource& source, const PlyHeader& header, const std::string& name,
                     const MeshReadOptions& options, MeshSink& sink);

// For both readers: checks that at most a few bytes are left, such as padding, and warns of them. `place`: of the first
// of them.
Status CheckPlyEnd(ByteSource& source, const std::string& name, const std::string& place,
                   const MeshReadOptions& options);

// False unless the value is a class index or -1.
bool LabelOf(int64_t value, int32_t& label);
bool LabelOf(double value, int32_t& label);
std::string ExpectedLabel(const PlyHeader& header, const MeshReadOptions& options);  // for messages

}  // namespace tessera
