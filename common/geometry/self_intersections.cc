#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>

#include <algorithm>
#include <exception>
#include <iterator>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/geometry/mesh_defects.h"

namespace tessera {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using SurfaceMesh = CGAL::Surface_mesh<Kernel::Point_3>;

}  // namespace

StatusOr<std::vector<std::array<uint32_t, 2>>> SelfIntersections(const TriangleMesh& mesh) {
  try {
    SurfaceMesh surface;
    std::vector<SurfaceMesh::Vertex_index> vertices;
    vertices.reserve(mesh.vertices.size());
    for (const Eigen::Vector3d& p : mesh.vertices) vertices.push_back(surface.add_vertex({p.x(), p.y(), p.z()}));
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      const auto& [a, b, c] = mesh.faces[f];
      if (surface.add_face(vertices[a], vertices[b], vertices[c]) == SurfaceMesh::null_face()) {
        return absl::FailedPreconditionError(absl::StrCat("mesh is not an oriented manifold: face ", f));
      }
    }
    std::vector<std::pair<SurfaceMesh::Face_index, SurfaceMesh::Face_index>> pairs;
    CGAL::Polygon_mesh_processing::self_intersections<CGAL::Sequential_tag>(surface, std::back_inserter(pairs));
    std::vector<std::array<uint32_t, 2>> result;
    result.reserve(pairs.size());
    for (const auto& [a, b] : pairs) {
      const uint32_t f = static_cast<uint32_t>(a), g = static_cast<uint32_t>(b);
      result.push_back({std::min(f, g), std::max(f, g)});
    }
    std::sort(result.begin(), result.end());
    return result;
  } catch (const std::exception& error) {
    return absl::FailedPreconditionError(absl::StrCat("cannot compute self-intersections: ", error.what()));
  }
}

}  // namespace tessera
