// Splits faces that cover many pixels, so that the mesh can represent the detail of the images.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"

namespace tessera {

struct DensityOptions {
  double max_footprint_px2 = 16;  // maximum area of a face in pixels, in the view that shows it largest
  int max_rounds = 8;             // an edge is halved at most this often
};

// Result of SplitLargeFaces. `mesh` has the input's vertices first, in their order. The new ones follow by round and,
// within a round, by the ids of the edge's ends (lower id, higher id).
struct SplitMesh {
  TriangleMesh mesh;                  // labels are inherited
  std::vector<uint32_t> parent_face;  // index of the input face that contains each face
  // halved_edges: per new vertex the edge that it halves (lower id, higher id). round_ends: number of new vertices
  // after each round.
  std::vector<std::array<uint32_t, 2>> halved_edges;
  std::vector<size_t> round_ends;
};

// Overrides the decision whether the edge between two vertices (lower id, higher id) is halved; nullopt: decide by
// the cameras. Asked once for each edge.
using EdgeRule = std::function<std::optional<bool>(uint32_t low, uint32_t high)>;

// Halves edges until no face's footprint should exceed the limit. An edge is split if its longest projection, over
// the cameras that have both ends in front and inside the image, exceeds the side of an equilateral triangle of the
// limit's area.
// The decision depends only on the edge's two ends and the cameras, so two meshes that share an edge split it alike.
// Orientation and occlusion are not tested. A face is replaced by the template for its 1, 2 or 3 split edges (for
// two, the diagonal starts at the lower id), so the surface does not change. The result is conforming and
// deterministic. Mesh and cameras in the same frame.
SplitMesh SplitLargeFaces(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras,
                          const DensityOptions& options, const EdgeRule& rule = {});

}  // namespace tessera
