// The mesh that the operators of a step start from.
#pragma once

#include <memory>

#include "common/geometry/csr_rows.h"
#include "common/geometry/mesh.h"

namespace tessera {

// An immutable mesh with the faces of its vertices. Copies share both. Thread-safe.
class StartSurface {
 public:
  // Implicit. Takes the mesh over if it is moved in, else copies it.
  StartSurface(TriangleMesh mesh = {});

  const TriangleMesh& mesh() const;
  // FacesOfVertices of the mesh, made at the first call.
  const CsrRows& faces_of_vertex() const;

 private:
  struct Data;
  std::shared_ptr<Data> data_;
};

}  // namespace tessera
