// The geometry of a mesh in memory, refined by the loop of a job's only tile, without a scene's files.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/geometry/mesh.h"
#include "worker/photo/data_term.h"
#include "worker/photo/pairs.h"
#include "worker/tile/methods.h"
#include "worker/tile/refine_tile.h"

namespace tessera {

// Everything in one metric frame.
struct SurfaceProblem {
  TriangleMesh mesh;              // oriented; labels choose the class weights
  std::vector<uint8_t> boundary;  // flags of vertices that do not move; empty: none
  std::vector<RefineView> views;
  double gsd_m = 0;
  std::vector<ViewPair> pairs;  // ordered, sorted by reference; empty: SelectPairs with `pairing`
  PairOptions pairing;
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  std::vector<int> levels = {2, 1, 0}, iterations = {4, 8, 6};
  int rounds = 1;  // of all levels
};

struct SurfaceRefinement {
  std::vector<Eigen::Vector3d> vertices;
  TileRefinement tile;
  int pairs = 0;
};

// The views must lie as a whole in memory. Labels do not change. Errors as RefineTile's.
StatusOr<SurfaceRefinement> RefineSurface(const SurfaceProblem& problem, const TileRefineOptions& options,
                                          const TaskControl& control = {}, const Clock& clock = SystemClock());

}  // namespace tessera
