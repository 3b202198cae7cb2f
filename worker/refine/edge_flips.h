// Final mesh improvement: flips edges so that they run along creases instead of across them (Dyn, Hormann, Kim,
// Levin: Optimizing 3D triangulations using discrete curvature analysis, 2001). Refinement moves vertices onto eaves
// and the feet of walls, but faces with corners on both sides of a crease still cut it, which gives a sawtooth.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"

namespace tessera {

// Greedily flips edges of `mesh` to minimise Σ |e| |n_f - n_g| over the edges e between faces with unit normals n_f
// and n_g; the largest gain first, as long as it is at least a fiftieth of the edge's length. Vertices do not move. A
// face keeps its index and label; the two faces of a flipped edge exchange one corner each.
// An edge is not flipped if its faces differ in label (class borders stay) or in `groups` (one number per face), if a
// face would become a sliver or would newly intersect another face of its group, or if the new edge may already
// exist. A mesh without non-manifold edges keeps that property.
// Each group is processed as a mesh of its own, so its result depends only on its faces, their vertices and labels,
// and the order of both. A tile with whole groups therefore needs no data of its neighbours, and an unchanged tile
// gets the same result whatever its neighbours are.
// Runs on all threads; the result does not depend on their number. About three microseconds per face. Returns the
// changed faces, ascending.
std::vector<uint32_t> FlipEdges(const std::vector<uint64_t>& groups, TriangleMesh* mesh);

}  // namespace tessera
