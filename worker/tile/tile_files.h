// What the tasks of a tile hand on, as values: its package, the sums over its pixels, its state after a step.
#ifndef TESSERA_WORKER_TILE_TILE_FILES_H_
#define TESSERA_WORKER_TILE_TILE_FILES_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>
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

// What the faces of a package are there for, as bits; all of them may be in sight of the tile's views.
enum Region : uint8_t {
  kCoreRegion = 1,
  kSolveRegion = 2,
  kRepairRegion = 4,
  kLabelRegion = 8,
  kSampleRegion = 16,  // a few of a neighbour's core, measured here as well to be compared
};

// The cells that a package is sorted by: small, so that few need be drawn; so many side by side are a ground cell.
inline constexpr int kPackageCellsAcross = 4;
inline GroundPlane PackageCells(GroundPlane ground) {
  ground.cell_m /= kPackageCellsAcross;
  return ground;
}

// All that the tile's tasks read but the pixels and the other tiles' states. Positions in the local frame, so that
// tiles compute with the same numbers. Faces come by their cell (y, then x), in a cell by global id; vertices by the
// cell that they lie in, in a cell by global id: any two packages have what they share in the same order.
struct TilePackage {
  int tile = 0;
  GroundPlane ground;
  double gsd_m = 0;
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  std::vector<SceneClass> classes;
  bool has_likelihoods = false;
  BorderTrusts borders;     // of the likelihoods (Survey)
  bool has_labels = false;  // the job's start has
  bool compares = false;    // some cell of the city chose both views of a pair: else no tile's geometry moves

  std::vector<SceneView> views;                    // those that the core's cells chose and their partners
  std::vector<int32_t> view_ids;                   // their indices in the survey
  std::vector<PixelRect> view_rects;               // of each, what its tasks may read of it (FindSight)
  std::vector<std::array<int32_t, 2>> pairs;       // ordered pairs of indices into `views`
  std::vector<std::array<double, 2>> view_depths;  // nearest and farthest of what the whole job looks at, metres

  std::vector<std::array<int32_t, 2>> cell_at;   // x, y of each cell (PackageCells)
  std::vector<std::vector<int32_t>> cell_views;  // the views that look at its faces (indices into `views`, ascending)
  MeshCells cells;

  TriangleMesh mesh;  // where it lies at the start, with the start's labels
  std::vector<uint32_t> vertex_ids, face_ids;
  std::vector<uint8_t> regions;      // of faces: Region bits
  std::vector<uint8_t> cut_regions;  // of vertices: regions that have some of the vertex's faces, but not all
};

Status WriteTilePackage(const std::string& path, const TilePackage& package);
StatusOr<TilePackage> ReadTilePackage(const std::string& path);

// What the pixels say of some faces of a neighbour's core, by ascending global id; as TileSums has it of its own.
struct TileSample {
  std::vector<uint32_t> face_ids;
  std::vector<FaceSums> photo;
  std::vector<float> likelihoods, pixels;
};

// What the pixels say of the core's faces, by ascending global id; of derivatives or of likelihoods, the others empty.
struct TileSums {
  int tile = 0;
  std::vector<uint32_t> face_ids;
  std::vector<FaceSums> photo;
  ContourSums contours;  // FaceContour::face: index into face_ids
  int classes = 0;
  std::vector<float> likelihoods, pixels;  // as FaceLikelihoods has them
  TileSample sample;
  // Means over the windows of the tile's pixels, for the report; -1: none.
  double energy = -1, semantic_energy = -1;
  int64_t warped_pixels = 0;
};

Status WriteTileSums(const std::string& path, const TileSums& sums);
StatusOr<TileSums> ReadTileSums(const std::string& path);

// The core of a tile after a step: its faces and the vertices that they use, by ascending global id. Vertices of
// several tiles are in each of them, equal byte for byte.
struct TileState {
  int tile = 0;
  std::vector<uint32_t> vertex_ids;
  std::vector<Eigen::Vector3d> positions;
  // When the level at hand began, and what its last iteration added; empty between levels.
  std::vector<Eigen::Vector3d> level_start;
  std::vector<Eigen::Vector3f> last_step;
  std::vector<uint32_t> face_ids;
  std::vector<int32_t> labels;
  std::vector<float> confidence;  // in [0, 1] (LabelConfidence), 0 where no view shows the face; as last labelled
  std::string report = "{}";      // JSON for the job's report; deterministic, so no seconds
};

Status WriteTileState(const std::string& path, const TileState& state);

// A state, wherever it lies.
struct StateSpans {
  StateSpans() = default;
  explicit StateSpans(const TileState& state);
  int tile = 0;
  std::span<const uint32_t> vertex_ids, face_ids;
  std::span<const Eigen::Vector3d> positions, level_start;
  std::span<const Eigen::Vector3f> last_step;
  std::span<const int32_t> labels;
  std::span<const float> confidence;
  std::string report;
};

// A state's file in the address space: a step reads those of all tiles in sight, and of most of them little.
class MappedState {
 public:
  // Reads it once and checks it: DATA_LOSS as MappedArrays::Open and Verified.
  static StatusOr<MappedState> Open(const std::string& path);
  const StateSpans& spans() const { return spans_; }

 private:
  MappedArrays file_;
  StateSpans spans_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_TILE_TILE_FILES_H_
