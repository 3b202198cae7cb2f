// Selects pairs of views for matching.
#pragma once

#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"

namespace tessera {

// An ordered pair: `other` is warped into `reference`.
struct ViewPair {
  int reference = 0;
  int other = 0;
  bool operator==(const ViewPair&) const = default;
};

struct PairOptions {
  int partners = 4;  // number that a view selects; may get more from views that select it
  double min_angle_rad = 0.0436;
  double max_angle_rad = 0.785;
  double best_angle_rad = 0.26;
  double max_scale_ratio = 2;  // maximum ratio of ground sampling distances at a point
  int samples = 4000;          // faces of the mesh that are evaluated
};

// Greedy selection of partners for each view. The score of a pair is summed over sample faces (evenly spaced in the
// mesh's list) that both views see from the front, by triangulation angle and scale; occlusion is not tested. A
// sample counts less if earlier partners already cover it. Symmetric: with (i, j) the result contains (j, i). Sorted
// by reference, then other. Depends only on the arguments.
// `choosers`: one flag per camera that selects partners; empty: all do.
std::vector<ViewPair> SelectPairs(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras,
                                  const PairOptions& options, const std::vector<uint8_t>& choosers = {});

// Reorders the views so that the views of a pair are close to each other (reverse Cuthill and McKee 1969). Returns
// the view index at each position.
std::vector<int> OrderByPairs(int views, const std::vector<ViewPair>& pairs);

}  // namespace tessera
