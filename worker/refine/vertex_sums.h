// From faces to vertices: what the data terms say of each face, gathered at its corners.
#ifndef TESSERA_WORKER_REFINE_VERTEX_SUMS_H_
#define TESSERA_WORKER_REFINE_VERTEX_SUMS_H_

#include <Eigen/Core>
#include <vector>

#include "common/geometry/csr_rows.h"
#include "common/geometry/mesh.h"
#include "worker/photo/contour_term.h"
#include "worker/photo/face_sums.h"

namespace tessera {

// The data terms' derivatives by the vertices. Of the photo term a vertex's entries are the sum over pairs divided by
// the mean number of pairs that see its faces, of the contour term the sum over views divided by their number.
struct PhotoDerivatives {
  std::vector<Eigen::Vector3d> gradient;   // per metre
  std::vector<Eigen::Matrix3d> curvature;  // per metre²; positive semidefinite, upper bound of Gauss-Newton's
  // Mean number of pairs on the vertex's faces whose window was accepted, or with E_sem that see it; 0: none does.
  std::vector<float> pairs;
};

// `sums`: one a face; `contours`: empty for none. Reads of a vertex its faces alone, in their order, so that whoever
// has all faces of a vertex gets the same bytes. Does not depend on the number of threads.
PhotoDerivatives GatherVertices(const TriangleMesh& mesh, const IndexRows& faces_of_vertex,
                                const std::vector<FaceSums>& sums, const ContourSums& contours);

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_VERTEX_SUMS_H_
