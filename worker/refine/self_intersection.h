// Faces that cut through each other: finding them, and undoing what a run made of them.
#ifndef TESSERA_WORKER_REFINE_SELF_INTERSECTION_H_
#define TESSERA_WORKER_REFINE_SELF_INTERSECTION_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "common/geometry/csr_rows.h"
#include "common/geometry/mesh.h"

namespace tessera {

// Two faces, the lower index first.
using FacePair = std::array<uint32_t, 2>;

// Boxes of a mesh's faces in a tree, whose order is that of the positions it was built from: they may move afterwards
// (Refit), at the cost of speed alone.
class FaceBoxes {
 public:
  explicit FaceBoxes(const TriangleMesh& mesh);
  void Refit(const TriangleMesh& mesh);

  // The pairs of faces that meet elsewhere than in the vertices or the edge that they share, at least one of them in
  // `active` (ascending), ascending. Exact (CGAL's predicates where a bounded rounding error leaves a doubt). `mesh` as
  // last refitted; faces without area meet nobody.
  std::vector<FacePair> Intersections(const TriangleMesh& mesh, const std::vector<uint32_t>& active) const;

 private:
  struct Box {
    std::array<float, 3> low, high;
  };
  bool Overlap(const Box& a, const Box& b) const;

  std::vector<uint32_t> order_;  // faces along the curve, kLeafFaces a leaf
  std::vector<Box> face_boxes_;  // in that order
  std::vector<Box> nodes_;       // a heap: children of i are 2i and 2i + 1, leaves last
  size_t leaves_ = 1;
};

// Of the whole mesh. Takes about a microsecond a face.
std::vector<FacePair> IntersectingFacePairs(const TriangleMesh& mesh);

// What `after` has and `before` has not; both ascending.
std::vector<FacePair> NewPairs(const std::vector<FacePair>& before, const std::vector<FacePair>& after);

// Takes back, as little and as locally as it can, the motion that made faces of a mesh cut each other or that turned
// them, in few fixed passes. One object serves all stages of a run.
class FoldRepair {
 public:
  using Positions = std::vector<Eigen::Vector3d>;
  // Whether a face may lie as it does in `to`, seen that it lay as in `from`; must hold where both are equal, and look
  // at nothing but the face's corners.
  using FaceTest = std::function<bool(uint32_t face, const Positions& from, const Positions& to)>;

  struct Result {
    int64_t spoiled_faces = 0;     // that cut each other anew, or failed the test, before the repair
    int64_t changed_vertices = 0;  // that were moved back, all or part of their way
    int passes = 0;                // that found something to do
    std::vector<uint32_t> left;    // faces that are spoiled still after the last pass, ascending
    bool clean() const { return left.empty(); }
  };

  // A pass takes the faces that are spoiled as the mesh lies. Vertices keep a share of their motion that is `least` at
  // the corners of those and rises evenly to all of it `rings` rings of edges away, or less if an earlier pass left
  // them less. Where the slope of shares has turned faces (test), kLevellings rounds give such a face's corners the
  // least share among them, or half of it where they are equal; the last two rounds, none.
  struct Pass {
    double least;
    int rings;
  };
  // Gentle at first: most faces are well with that. Then wholly back, over ever more rings, for steep slopes spoil
  // other faces. Two or three passes leave nothing on the scenes at hand (of 450,000 faces 400 are spoiled by a level).
  static constexpr std::array<Pass, 4> kPasses = {{{0.5, 4}, {0.25, 6}, {0, 8}, {0, 10}}};
  static constexpr int kLevellings = 8;

  // Reach. What a pass makes of a vertex depends on the motion of the vertices and the faces about them within so many
  // rings (faces with a corner within them), and on the faces that these touch: whose boxes, as their corners lie in
  // the pass, have a point in common. So after all passes it depends on what as many steps of "rings, then one contact"
  // reach, the last pass's rings first; on nothing else, nor on the numbers of vertices and faces but for their order.
  static constexpr int RingsOf(const Pass& pass) { return pass.rings - 1 + kLevellings; }

  // The pairs that cut each other in `start` stay allowed. `faces_of_vertex` must outlive this.
  FoldRepair(const TriangleMesh& start, const IndexRows& faces_of_vertex);

  // `vertices`: positions that a stage made of `good`. Afterwards, if the result is clean, no two faces cut each other
  // that did not at the start, and every face passes `test` (may be null): about the faces where that was not so, the
  // vertices were drawn back towards `good`. What did not move stays. The result does not depend on the number of
  // threads.
  Result Run(const Positions& good, const FaceTest& test, Positions* vertices);

 private:
  class Motion;

  const TriangleMesh start_;
  const IndexRows& faces_of_vertex_;
  FaceBoxes boxes_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_SELF_INTERSECTION_H_
