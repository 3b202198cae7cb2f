// The Markov random field over a mesh's faces that labelling minimises, and its adjacency.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "common/geometry/edge_list.h"
#include "common/geometry/mesh.h"
#include "common/scene/scene.h"
#include "worker/label/cells.h"
#include "worker/label/unary.h"

namespace tessera {

// An edge of the field: `weight` is the cost of different labels at its ends.
struct FieldEdge {
  uint32_t face0 = 0, face1 = 0;
  float weight = 0;
};

// Pairwise Potts field: E(l) = Σ_f unary[f, l_f] + Σ_edges weight [l differs].
struct LabelField {
  int classes = 0;
  std::vector<float> unary;  // faces x classes
  std::vector<FieldEdge> edges;
  // Label cell of each face, for block coordinate descent; empty: all faces form one block. Must not depend on the
  // tile: squares of kLabelCellGsd in plan, by the face's centroid in the start mesh.
  std::vector<Cell> cell;
  size_t faces() const { return classes == 0 ? 0 : unary.size() / classes; }
};

inline constexpr double kLabelCellGsd = 32;

struct LabelOptions {
  // kTessera: unary and pairwise terms scale with face area and edge length in units of the GSD, and p is a mean over
  // pixels. So neither subdivision nor tiling changes the result. kPaper: -log of the sum of likelihoods; prior and
  // Potts term in square metres (Bláha et al. 2017, section 3.2).
  enum class Form { kTessera, kPaper };
  Form form = Form::kTessera;
  double prior_weight = 0.35;       // μ1
  double smoothness_weight = 0.25;  // μ2; the paper has 0.5
  double unsure_pixels = 1;         // kTessera: pseudo-count per class and area A0, in pixels
  double floor = 1e-3;              // lower bound of a likelihood
};

// Builds the field of `mesh` (metres). `edges`: EdgeList of the mesh; boundary edges are skipped. `up`: unit vector
// in the mesh's frame. `gsd_m`: of the job. classes.size() == likelihoods.classes. The caller fills `cell`.
// For a submesh with vertices and faces in the same order, the result is the same field without the other faces:
// unaries and weights depend on single faces and edges, and EdgeList's order is that of the vertices.
LabelField BuildLabelField(const MeshSpans& mesh, const std::vector<MeshEdge>& edges,
                           const FaceLikelihoods& likelihoods, const std::vector<SceneClass>& classes,
                           const Eigen::Vector3d& up, double gsd_m, const LabelOptions& options);

// One end of an edge: the neighbour, the weight, and the index of the edge in the field.
struct FieldLink {
  uint32_t face = 0;
  float weight = 0;
  uint32_t edge = 0;
};

struct FieldGraph {
  std::vector<uint32_t> offsets;  // faces + 1
  std::vector<FieldLink> links;   // those of face f from offsets[f], in the order of the field's edges
  std::span<const FieldLink> operator[](size_t face) const {
    return {links.data() + offsets[face], offsets[face + 1] - offsets[face]};
  }
};

// Edges of weight 0 are left out.
FieldGraph MakeFieldGraph(const LabelField& field);

}  // namespace tessera
