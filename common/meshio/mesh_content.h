// A mesh as files hold it, whole or element by element.
#pragma once

#include <cstdint>

#include "common/base/status.h"
#include "common/geometry/mesh.h"

namespace tessera {

struct MeshContent {
  TriangleMesh mesh;             // labels empty if the file has none
  bool float_positions = false;  // the file stores x, y, z as 32-bit floats
};

// Receives a mesh element by element, in the order of the file.
class MeshSink {
 public:
  virtual ~MeshSink() = default;
  // Called first, with the counts that the file declares. The file may be shorter.
  virtual Status Begin(int64_t vertices, int64_t faces, bool has_labels, bool float_positions) = 0;
  virtual void AddVertex(const Eigen::Vector3d& position) = 0;
  virtual void AddFace(const Triangle& vertices, int32_t label) = 0;  // `label`: 0 if the file has none
};

}  // namespace tessera
