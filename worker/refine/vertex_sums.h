// Gathers the data terms' face derivatives at the vertices.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "common/geometry/csr_rows.h"
#include "common/geometry/mesh.h"
#include "worker/photo/contour_term.h"
#include "worker/photo/face_sums.h"

namespace tessera {

// Derivatives of the data terms per vertex. Photo term: the sum over pairs divided by the mean number of pairs that
// see the vertex's faces. Contour term: the sum over views divided by their number.
struct PhotoDerivatives {
  std::vector<Eigen::Vector3d> gradient;   // per metre
  std::vector<Eigen::Matrix3d> curvature;  // per metre²; positive semidefinite upper bound of the Gauss-Newton matrix
  // Mean number of pairs of the vertex's faces with accepted windows (with E_sem: that see the pixels); 0: none.
  std::vector<float> pairs;
};

// `sums`: one per face; `contours`: may be empty. A vertex depends only on its own faces, in their order, so every
// submesh with all faces of a vertex gives it the same bytes. Does not depend on the number of threads.
PhotoDerivatives GatherVertices(const MeshSpans& mesh, const CsrRows& faces_of_vertex,
                                const std::vector<FaceSums>& sums, const ContourSums& contours);

}  // namespace tessera
