// Self-intersections of a mesh computed by CGAL.
#pragma once

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <iterator>
#include <utility>
#include <vector>

#include "worker/refine/self_intersection.h"

namespace tessera {

// The oracle: CGAL's own search on its own mesh type.
inline std::vector<FacePair> PairsByCgal(const TriangleMesh& mesh) {
  using Surface = CGAL::Surface_mesh<CGAL::Exact_predicates_inexact_constructions_kernel::Point_3>;
  Surface surface;
  for (const Eigen::Vector3d& p : mesh.vertices) surface.add_vertex({p.x(), p.y(), p.z()});
  for (const Triangle& f : mesh.faces) {
    EXPECT_NE(surface.add_face(Surface::Vertex_index(f[0]), Surface::Vertex_index(f[1]), Surface::Vertex_index(f[2])),
              Surface::null_face());
  }
  std::vector<std::pair<Surface::Face_index, Surface::Face_index>> pairs;
  CGAL::Polygon_mesh_processing::self_intersections<CGAL::Sequential_tag>(surface, std::back_inserter(pairs));
  std::vector<FacePair> out;
  for (const auto& [f, g] : pairs) {
    const auto a = static_cast<uint32_t>(f), b = static_cast<uint32_t>(g);
    out.push_back({std::min(a, b), std::max(a, b)});
  }
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace tessera
