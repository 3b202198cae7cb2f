// The elements of a PLY file after its header.
#ifndef TESSERA_COMMON_MESHIO_PLY_BODY_H_
#define TESSERA_COMMON_MESHIO_PLY_BODY_H_

#include <string>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/meshio/byte_source.h"
#include "common/meshio/ply.h"
#include "common/meshio/ply_header.h"

namespace tessera {

// Both read all elements that `header` declares from `source`, which stands right after it, into `sink`, and check that
// nothing follows. INVALID_ARGUMENT with the line or the byte offset.
Status ReadPlyText(ByteSource& source, const PlyHeader& header, const std::string& name, MeshSink& sink);
Status ReadPlyBinary(ByteSource& source, const PlyHeader& header, const std::string& name, MeshSink& sink);

// Room for the declared vertices and faces, but no more than `source` can hold.
void ReserveMesh(const ByteSource& source, const PlyHeader& header, TriangleMesh& mesh);

}  // namespace tessera

#endif  // TESSERA_COMMON_MESHIO_PLY_BODY_H_
