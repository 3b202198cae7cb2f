#include "worker/refine/start_surface.h"

#include <mutex>
#include <utility>

#include "worker/refine/one_rings.h"

namespace tessera {

struct StartSurface::Data {
  const TriangleMesh mesh;
  std::once_flag has_rows;
  CsrRows faces_of_vertex;

  explicit Data(TriangleMesh of) : mesh(std::move(of)) {}
};

StartSurface::StartSurface(TriangleMesh mesh) : data_(std::make_shared<Data>(std::move(mesh))) {}

const TriangleMesh& StartSurface::mesh() const { return data_->mesh; }

const CsrRows& StartSurface::faces_of_vertex() const {
  std::call_once(data_->has_rows, [&] { data_->faces_of_vertex = FacesOfVertices(data_->mesh); });
  return data_->faces_of_vertex;
}

}  // namespace tessera
