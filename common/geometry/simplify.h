// Fewer faces for the same surface, within a distance that is checked and not only aimed at.
#ifndef TESSERA_COMMON_GEOMETRY_SIMPLIFY_H_
#define TESSERA_COMMON_GEOMETRY_SIMPLIFY_H_

#include <cstdint>

#include "common/geometry/mesh.h"

namespace tessera {

// A surface with fewer faces, by collapsing edges (quadric errors, Garland and Heckbert 1997; meshoptimizer). Neither
// surface has a point farther than `tolerance_m` from the other, as far as vertices and samples as dense as those of
// `mesh` tell, which must lie well within. Vertices are a subset of the input's, in its order, unmoved. Edges with one
// face stay as they are, so parts that are simplified each for itself fit together as before and no hole opens; so do
// edges with more than two faces. The result need not be manifold. Labels are dropped. Where less cannot be had within
// the tolerance the mesh comes back, without vertices of no face. One thread; same input, same bytes. Thread-safe.
TriangleMesh SimplifyMesh(const TriangleMesh& mesh, double tolerance_m);

}  // namespace tessera

#endif  // TESSERA_COMMON_GEOMETRY_SIMPLIFY_H_
