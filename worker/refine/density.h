// Splitting faces that cover many pixels, so that the mesh can follow the images' detail.
#ifndef TESSERA_WORKER_REFINE_DENSITY_H_
#define TESSERA_WORKER_REFINE_DENSITY_H_

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"

namespace tessera {

struct DensityOptions {
  double max_footprint_px2 = 16;  // of a face: its area in pixels in the view that sees it largest
  int max_rounds = 8;             // an edge is halved at most this often
};

// `mesh` contains the input's vertices first, in their order; then the new ones, round by round, in the order of the
// ids of their edges' ends (lower id, higher id).
struct SplitMesh {
  TriangleMesh mesh;                  // labels inherited
  std::vector<uint32_t> parent_face;  // the input face each face lies in
  // Each new vertex: the edge that it halves (lower id, higher id); after each round: how many new vertices there are.
  std::vector<std::array<uint32_t, 2>> halved_edges;
  std::vector<size_t> round_ends;
};

// Whether the edge between these vertices (lower id, higher id) is halved, whatever the cameras say; none: they decide.
// Thread-safe.
using EdgeRule = std::function<std::optional<bool>(uint32_t low, uint32_t high)>;

// Halves edges until no face's footprint should exceed the limit: an edge is split where its longest projection (over
// the cameras that have both of its ends inside the image, each end in front) is longer than the side of an equilateral
// triangle of that area. Decided from the edge's two end points and the cameras alone, so that everyone who shares an
// edge splits it alike; orientation and occlusion are not asked. A face takes the template of its 1, 2 or 3 split edges
// (of two, the diagonal starts at the lower id), so the surface itself does not change. Conforming, deterministic. Mesh
// and cameras in one frame.
SplitMesh SplitLargeFaces(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras,
                          const DensityOptions& options, const EdgeRule& rule = {});

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_DENSITY_H_
