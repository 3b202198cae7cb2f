// Detects self-intersections of a mesh, and repairs those that a motion has caused.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "common/geometry/csr_rows.h"
#include "common/geometry/mesh.h"

namespace tessera {

// Two face indices, the lower one first.
using FacePair = std::array<uint32_t, 2>;

// Bounding box tree over a mesh's faces. Its order is that of the positions at construction. Positions may change
// afterwards (Refit); large changes make queries slower but not wrong.
class FaceBoxes {
 public:
  explicit FaceBoxes(const MeshSpans& mesh);
  void Refit(const MeshSpans& mesh);

  // Ascending pairs of faces that intersect other than in shared vertices or a shared edge, and of which at least one
  // is in `active` (ascending). Exact: CGAL's predicates decide where a bounded rounding error cannot. `mesh`: as in
  // the last Refit. Degenerate faces intersect nothing.
  std::vector<FacePair> Intersections(const MeshSpans& mesh, const std::vector<uint32_t>& active) const;

 private:
  struct Box {
    std::array<float, 3> low, high;
  };
  bool Overlap(const Box& a, const Box& b) const;

  std::vector<uint32_t> order_;  // faces along a space-filling curve, kLeafFaces per leaf
  std::vector<Box> face_boxes_;  // in the same order
  std::vector<Box> nodes_;       // a heap: children of i are 2i and 2i + 1, leaves last
  size_t leaves_ = 1;
};

// All intersecting pairs. Takes about a microsecond per face.
std::vector<FacePair> IntersectingFacePairs(const MeshSpans& mesh);

// Pairs in `after` that are not in `before`; both ascending.
std::vector<FacePair> NewPairs(const std::vector<FacePair>& before, const std::vector<FacePair>& after);

// Undoes motion that made faces intersect or inverted them, as locally as possible, in a fixed number of passes. One
// object serves all stages of a run.
class SurfaceRepair {
 public:
  using Positions = std::vector<Eigen::Vector3d>;
  // Whether the position of a face in `to` is acceptable given its position in `from`. Must be true if both are
  // equal, and must only read the face's corners.
  using FaceTest = std::function<bool(uint32_t face, const Positions& from, const Positions& to)>;

  struct Result {
    int64_t changed_vertices = 0;  // vertices moved back, completely or in part
    int passes = 0;                // passes that changed something
    std::vector<uint32_t> left;    // faces still defective after the last pass, ascending
  };

  // A pass moves vertices back around the defective faces: their corners keep the share `least` of their motion, and
  // the share rises linearly to 1 over `rings` rings, but never above that of an earlier pass. If the gradient of the
  // shares inverts faces, kSmoothingPasses smoothing rounds give such a face's corners their smallest share, or half of
  // it if they are equal, and 0 in the last two rounds.
  struct Pass {
    double least;
    int rings;
  };
  // The first passes are mild, which suffices for most faces. Later ones move back completely, over more and more
  // rings, since steep gradients of the shares cause other defects. On the test scenes two or three passes leave no
  // defects (of 450,000 faces 400 are defective after a level).
  static constexpr std::array<Pass, 4> kPasses = {{{0.5, 4}, {0.25, 6}, {0, 8}, {0, 10}}};
  static constexpr int kSmoothingPasses = 8;

  // Dependency radius of a pass: a vertex depends on the motion of vertices and faces within RingsOf rings (faces
  // with a corner inside), and on the faces that touch these, i.e. whose boxes at their positions in the pass
  // intersect. After all passes it depends on what the steps "rings, then one contact" reach, one step per pass, the
  // last pass's rings first. It does not depend on the numbering of vertices and faces except for their order.
  static constexpr int RingsOf(const Pass& pass) { return pass.rings - 1 + kSmoothingPasses; }

  // Pairs that intersect in `start` are accepted. Both must outlive the object.
  SurfaceRepair(const TriangleMesh& start, const CsrRows& faces_of_vertex);

  // `vertices`: positions that a stage produced from `good`. If no faces are left, no two faces intersect that did not
  // at the start or in `good`, and every face passes `test` (may be null): vertices around defective faces are moved
  // back towards `good`. Vertices that did not move stay. The result does not depend on the number of threads.
  // `tested`: flags of the faces whose defects count at first, e.g. those within a core's dependency radius; empty: all.
  Result Run(const Positions& good, const FaceTest& test, Positions* vertices, const std::vector<uint8_t>& tested = {});

 private:
  class Motion;

  const TriangleMesh& start_;
  const CsrRows& faces_of_vertex_;
  FaceBoxes boxes_;
};

}  // namespace tessera
