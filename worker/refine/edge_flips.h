// The last word on shape: edges of the refined mesh are flipped so that they run along its creases instead of across
// (Dyn, Hormann, Kim, Levin: Optimizing 3D triangulations using discrete curvature analysis, 2001). Refinement moves
// vertices onto eaves and the feet of walls, but a face whose corners lie on both sides of a crease cuts it like a
// tooth of a saw.
#ifndef TESSERA_WORKER_REFINE_EDGE_FLIPS_H_
#define TESSERA_WORKER_REFINE_EDGE_FLIPS_H_

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"

namespace tessera {

// Flips edges of `mesh` as long as Σ |e| |n_f - n_g| falls, over the edges e between faces of unit normals n_f and n_g,
// by a fiftieth of the edge's length or more; the greatest fall first. No vertex moves, a face keeps its number and
// label, two faces of one edge exchange a corner each, and a mesh without non-manifold edges stays one. An edge stays
// where its faces have different labels (so borders of classes stay), or lie in different `groups` (one number a face),
// where a face would become a sliver or cut another of its group that it did not cut before, or where the new edge
// might be there already.
// Each group is a mesh of its own for this: what becomes of its faces depends on nothing but these, their vertices and
// labels, and the order of both. A tile that has whole groups needs nothing of others, and one that is kept stays as it
// is whatever its neighbours become. Uses the process's threads; the result does not depend on their number. Takes
// about three microseconds a face. Returns the faces that changed, ascending.
std::vector<uint32_t> FlipEdges(const std::vector<uint64_t>& groups, TriangleMesh* mesh);

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_EDGE_FLIPS_H_
