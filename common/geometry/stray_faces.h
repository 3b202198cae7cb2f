// Vertices that lie far from all that the views show, such as one at the origin of a mesh in UTM coordinates.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/geometry/viewpoint.h"

namespace tessera {

struct StrayFaces {
  std::vector<uint32_t> vertices;  // stray, and in a face; ascending
  std::vector<uint32_t> faces;     // with a stray vertex; ascending
};

// The extent is the larger of the diagonal of the box of the views' centres and the median distance of the mesh from
// its middle. A vertex is stray if its distance from the middle of that box is
// - more than 50 times the extent, or
// - more than twice the extent, and it is `file_origin` (a vertex that was never set), or each edge of it is longer
//   than twice the extent and leads to a vertex that is nearer than that (a spike).
// Without views no vertex is stray. Positions are finite. Memory: a byte per vertex if one is farther than twice the
// extent.
StrayFaces FindStrayFaces(const MeshSpans& mesh, std::span<const Viewpoint> views, const Eigen::Vector3d& file_origin);

// Collapses the faces to one of their stray vertices, and moves these into the box of the views' centres, so that no
// later step depends on them. The caller removes the faces.
void CollapseStrayFaces(const StrayFaces& stray, std::span<const Viewpoint> views, std::span<Eigen::Vector3d> vertices,
                        std::span<Triangle> faces);

}  // namespace tessera
