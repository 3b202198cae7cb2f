// Files exchanged by the tasks of a tile: its package, sums of a step, state after a step. Functions are thread-safe.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/arrays/mapped_arrays.h"
#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/imaging/border_trust.h"
#include "common/job/ground.h"
#include "common/scene/scene.h"
#include "worker/photo/contour_term.h"
#include "worker/photo/face_sums.h"
#include "worker/visibility/image_window.h"
#include "worker/visibility/mesh_cells.h"

namespace tessera {

// Why a package contains a face, as bits. Any of the faces may be visible in the tile's views.
enum Region : uint8_t {
  kCoreRegion = 1,
  kSolveRegion = 2,
  kRepairRegion = 4,
  kLabelRegion = 8,
  kSampleRegion = 16,  // some faces of a neighbour's core that this tile measures as well, to compare the results
};

// Number of package cells per side of a ground cell. A package is sorted by these cells; they are small, so that few
// faces are rendered per window.
inline constexpr int kPackageCellsAcross = 4;
inline GroundPlane PackageCells(GroundPlane ground) {
  ground.cell_m /= kPackageCellsAcross;
  return ground;
}

// Everything that the tile's tasks read, except pixels and other tiles' states. Positions in the local frame, so that
// all tiles compute with equal numbers. Faces are sorted by cell (y, then x), then global id; vertices by the cell
// that contains them, then global id. So any two packages have their common faces and vertices in the same order.
struct TilePackage {
  int tile = 0;
  GroundPlane ground;
  double gsd_m = 0;
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  std::vector<SceneClass> classes;
  bool has_likelihoods = false;
  BorderTrusts borders;     // of the likelihoods (Survey)
  bool has_labels = false;  // whether the job's start has labels
  bool has_pairs = false;   // whether some cell of the city selects both views of a pair; if not, no vertex moves

  std::vector<SceneView> views;                    // selected by the core's cells, and their partners
  std::vector<int32_t> view_ids;                   // their indices in the survey
  std::vector<PixelRect> view_rects;               // per view: the window that its tasks may read (FindVisibleSet)
  std::vector<std::array<int32_t, 2>> pairs;       // ordered pairs of indices into `views`
  std::vector<std::array<double, 2>> view_depths;  // nearest and farthest surface that the whole job matches, metres

  std::vector<std::array<int32_t, 2>> cell_at;  // x, y of each cell (PackageCells)
  std::vector<std::vector<int32_t>>
      cell_views;  // views selected for the cell's faces (indices into `views`, ascending)
  MeshCells cells;

  TriangleMesh mesh;  // at the start, with the start's labels
  std::vector<uint32_t> vertex_ids, face_ids;
  std::vector<uint8_t> regions;      // of faces: Region bits
  std::vector<uint8_t> cut_regions;  // per vertex: regions that contain some but not all of its faces
};

Status WriteTilePackage(const std::string& path, const TilePackage& package);
StatusOr<TilePackage> ReadTilePackage(const std::string& path);
// Without the mesh and the cells.
StatusOr<TilePackage> ReadTileViews(const std::string& path);

// Sums over some faces, by ascending global id: either derivatives or likelihoods, the others are empty.
struct FaceSumsById {
  std::vector<uint32_t> face_ids;
  std::vector<FaceSums> photo;
  std::vector<float> likelihoods, pixels;  // as in FaceLikelihoods
};

// Sums of the data term over the core's faces.
struct TileSums : FaceSumsById {
  int tile = 0;
  ContourSums contours;  // FaceContour::face: index into face_ids
  int classes = 0;
  FaceSumsById sample;  // of some faces of a neighbour's core
  // Means over the windows of the tile's pixels, for the report; -1: none.
  double energy = -1, semantic_energy = -1;
  int64_t warped_pixels = 0;
  std::string fit;  // StepSums::fit
};

// Sums of several tiles.
using SumsOfTiles = std::vector<std::shared_ptr<const TileSums>>;

Status WriteTileSums(const std::string& path, const TileSums& sums);
StatusOr<TileSums> ReadTileSums(const std::string& path);

// The core of a tile after a step: its faces and their vertices, by ascending global id. Vertices shared by tiles are
// in each of them, equal byte for byte.
struct TileState {
  int tile = 0;
  std::vector<uint32_t> vertex_ids;
  std::vector<Eigen::Vector3d> positions;
  // Positions at the start of the current level, and the step of its last iteration; empty between levels.
  std::vector<Eigen::Vector3d> level_start;
  std::vector<Eigen::Vector3f> last_step;
  std::vector<uint32_t> face_ids;
  std::vector<int32_t> labels;
  std::vector<float> confidence;  // in [0, 1] (LabelConfidence), 0 if no view shows the face; of the last labelling
  std::string report = "{}";      // JSON for the job's report; deterministic, without times
};

// Mean of the confidences above 0; 0 if there is none. For statistics.
double MeanConfidence(const TileState& state);

Status WriteTileState(const std::string& path, const TileState& state);

// A view of a state.
struct StateSpans {
  int tile = 0;
  std::span<const uint32_t> vertex_ids, face_ids;
  std::span<const Eigen::Vector3d> positions, level_start;
  std::span<const Eigen::Vector3f> last_step;
  std::span<const int32_t> labels;
  std::span<const float> confidence;
  std::string report;
};

// A memory-mapped state file: a step reads the states of all visible tiles, mostly small parts of them.
class MappedState {
 public:
  // Reads and verifies the whole file: DATA_LOSS as MappedArrays::Open and Verified.
  static StatusOr<MappedState> Open(const std::string& path);
  const StateSpans& spans() const { return spans_; }

 private:
  MappedArrays file_;
  StateSpans spans_;
};
using StatesOfTiles = std::vector<std::shared_ptr<const MappedState>>;

}  // namespace tessera
