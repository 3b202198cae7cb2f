// The random field over a mesh's faces whose best labelling is wanted.
#ifndef TESSERA_WORKER_LABEL_LABEL_FIELD_H_
#define TESSERA_WORKER_LABEL_LABEL_FIELD_H_

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "common/geometry/edge_list.h"
#include "common/geometry/mesh.h"
#include "common/scene/scene.h"
#include "worker/label/cells.h"
#include "worker/label/unary.h"

namespace tessera {

// An edge of the field with the cost of different labels at its ends.
struct FieldEdge {
  uint32_t face0 = 0, face1 = 0;
  float weight = 0;
};

// Pairwise Potts field: E(l) = Σ_f unary[f, l_f] + Σ_edges weight [l differs].
struct LabelField {
  int classes = 0;
  std::vector<float> unary;  // faces x classes
  std::vector<FieldEdge> edges;
  // Ground cell of each face, in blocks of which the solver's last part proceeds; none: all faces in one block. What a
  // tile holds must not change it: squares of kLabelCellGsd in plan, by the face's centroid in the start mesh.
  std::vector<Cell> cell;
  size_t faces() const { return classes == 0 ? 0 : unary.size() / classes; }
};

inline constexpr double kLabelCellGsd = 32;

struct LabelOptions {
  // kTessera: every term grows with the face and the edge in units of the GSD, p is normalised, so that neither
  // splitting nor tiling changes anything. kPaper: -log of the plain sum of likelihoods; prior and Potts term in square
  // metres (Bláha et al. 2017, section 3.2).
  enum class Form { kTessera, kPaper };
  Form form = Form::kTessera;
  double prior_weight = 0.35;       // μ1
  double smoothness_weight = 0.25;  // μ2; the paper has 0.5
  double unsure_pixels = 1;         // kTessera: each class gets the likelihoods of so many pixels more for an area A0
  double floor = 1e-3;              // no likelihood is taken to be less than this
};

// Field of `mesh` (metres). `edges`: EdgeList of its topology; rims take no part. `up`: unit, the mesh's frame.
// `gsd_m`: the job's. classes.size() == likelihoods.classes. Cells are left to the caller.
// Of a mesh with some of the faces, and vertices and faces in the same order, it is the same field without the other
// faces: unaries and weights come from the faces at hand alone, and EdgeList's order is that of the vertices.
LabelField BuildLabelField(const TriangleMesh& mesh, const std::vector<MeshEdge>& edges,
                           const FaceLikelihoods& likelihoods, const std::vector<SceneClass>& classes,
                           const Eigen::Vector3d& up, double gsd_m, const LabelOptions& options);

// E of a labelling, every label in [0, classes).
double LabelEnergy(const LabelField& field, const std::vector<int32_t>& labels);

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_LABEL_FIELD_H_
