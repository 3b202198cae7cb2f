// Which views are compared with which.
#ifndef TESSERA_WORKER_PHOTO_PAIRS_H_
#define TESSERA_WORKER_PHOTO_PAIRS_H_

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
  int partners = 4;  // that a view chooses; being chosen by others may give it more
  double min_angle_rad = 0.0436;
  double max_angle_rad = 0.785;
  double best_angle_rad = 0.26;
  double max_scale_ratio = 2;  // of ground sampling distances at a point
  int samples = 4000;          // points of the mesh that vote
};

// Chooses partners of each view by what sample faces of the mesh (at even steps through its list) see of both:
// triangulation angle, scale, both fronts visible within the frusta (occlusion is not asked); each further partner
// counts most where the earlier ones see little. Symmetric: (i, j) and (j, i) are both in the result, which is sorted
// by reference, then other. A pure function of its arguments.
// `choosers`: a flag a camera, of those that choose; empty: all do.
std::vector<ViewPair> SelectPairs(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras,
                                  const PairOptions& options, const std::vector<uint8_t>& choosers = {});

// The views in an order in which the views of a pair are near each other (reverse Cuthill and McKee 1969): a view's
// index at each place.
std::vector<int> OrderByPairs(int views, const std::vector<ViewPair>& pairs);

}  // namespace tessera

#endif  // TESSERA_WORKER_PHOTO_PAIRS_H_
