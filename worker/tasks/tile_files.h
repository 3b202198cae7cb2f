// What cut, refine and stitch hand on, as values: a tile's package, its result, its stitched core.
#ifndef TESSERA_WORKER_TASKS_TILE_FILES_H_
#define TESSERA_WORKER_TASKS_TILE_FILES_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/scene/scene.h"
#include "common/tile/ground.h"
#include "common/tile/task_parameters.h"

namespace tessera {

// All that refining a tile reads but the pixels. Positions in the local frame, so that tiles compute with the same
// numbers.
struct TilePackage {
  int tile = 0;
  GroundPlane ground;
  double gsd_m = 0;
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  std::vector<SceneClass> classes;
  std::vector<SceneView> views;               // those that the plan chose, in the scene's order
  std::vector<std::array<int32_t, 2>> pairs;  // ordered pairs of indices into `views`
  bool has_likelihoods = false;
  // What views see, as the whole job has it: of each view the nearest and farthest depth of what it looks at, metres;
  // of each of the ground's cells about the tile the views that look at its faces (indices into `views`, ascending).
  std::vector<std::array<double, 2>> view_depths;
  std::vector<std::vector<int32_t>> cell_views;

  TriangleMesh mesh;                 // core and halo; manifold: vertices where the cut makes fans touch are doubled
  std::vector<uint32_t> vertex_ids;  // global, ascending but for doubled ones at the end
  std::vector<uint32_t> face_ids;    // global, ascending
  std::vector<uint8_t> fixed;        // vertices: 1 on the tile's cut
  std::vector<uint8_t> core;         // faces: 1 in the core
  std::vector<uint32_t> cell;        // faces: index into cell_views
  TriangleMesh occluders;            // whatever may hide the tile from its views and is no part of it
};

Status WriteTilePackage(const std::string& path, const TilePackage& package);
StatusOr<TilePackage> ReadTilePackage(const std::string& path);

// What refining made of a tile, or some of its steps: of the core and what lies about it, in the package's order.
struct TileResult {
  int tile = 0;
  std::vector<uint32_t> vertex_ids, face_ids;  // global
  std::vector<Eigen::Vector3d> positions;      // refined, local frame
  std::vector<Eigen::Vector3d> level_start;    // when the level at hand began; empty between levels
  std::vector<int32_t> labels;                 // best labels
  int classes = 0;
  // After the last step; empty before.
  std::vector<float> beliefs;  // faces x classes, costs, 0 for the best
  std::vector<uint8_t> seen;   // faces: 0 if the label is its neighbours' word, for no view with likelihoods shows it
  std::string report = "{}";   // JSON for the job's report; deterministic, so no seconds
};

Status WriteTileResult(const std::string& path, const TileResult& result);
StatusOr<TileResult> ReadTileResult(const std::string& path);
// Those of several tiles among a task's inputs.
StatusOr<std::vector<TileResult>> ReadTileResults(const std::string& input_dir,
                                                  const std::vector<TileParameters>& tiles);

// A core, blended with its neighbours. Vertices of two cores are in both, equal byte for byte.
struct TileCore {
  int tile = 0;
  std::vector<uint32_t> vertex_ids;  // global, ascending, each once
  std::vector<Eigen::Vector3d> positions;
  std::vector<uint32_t> face_ids;  // global, ascending
  std::vector<int32_t> labels;
  std::vector<float> confidence;  // in [0, 1] (LabelConfidence); 0 where no view shows the face
  std::string report = "{}";      // the tile's, and what the seam looked like
};

Status WriteTileCore(const std::string& path, const TileCore& core);
StatusOr<TileCore> ReadTileCore(const std::string& path);

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_TILE_FILES_H_
