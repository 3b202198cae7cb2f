// Faces that cut through each other: finding them, and undoing what a run made of them.
#ifndef TESSERA_WORKER_REFINE_SELF_INTERSECTION_H_
#define TESSERA_WORKER_REFINE_SELF_INTERSECTION_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/geometry/topology.h"

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
// them. One object serves all stages of a run.
class FoldRepair {
 public:
  using Positions = std::vector<Eigen::Vector3d>;
  // Whether a face may lie as it does in `to`, seen that it lay as in `from`; must hold where both are equal.
  using FaceTest = std::function<bool(uint32_t face, const Positions& from, const Positions& to)>;

  struct Result {
    int64_t spoiled_faces = 0;     // that cut each other anew, or failed the test, before the repair
    int64_t changed_vertices = 0;  // that were moved back, all or part of their way
    int passes = 0;
    bool clean = true;  // false only if `good` itself had pairs that the start had not
  };

  // The pairs that cut each other in `start` stay allowed. `faces_of_vertex` must outlive this.
  FoldRepair(const TriangleMesh& start, const IndexRows& faces_of_vertex);

  // `vertices`: positions that a stage made of `good`. Afterwards no two faces cut each other that did not at the
  // start, and every face passes `test` (may be null; must hold of a face that did not move): about the faces where
  // that was not so, the vertices were drawn back towards `good`, half way at first, wholly in the end, with a gentle
  // rim of a few rings; again, where that spoiled other faces. The result does not depend on the number of threads;
  // what happens to a vertex depends on the patch about it.
  Result Run(const Positions& good, const FaceTest& test, Positions* vertices);

  const std::vector<FacePair>& start_pairs() const { return start_pairs_; }

 private:
  std::vector<Triangle> faces_;
  const IndexRows& faces_of_vertex_;
  FaceBoxes boxes_;
  std::vector<FacePair> start_pairs_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_SELF_INTERSECTION_H_
