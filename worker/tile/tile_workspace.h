// A tile's package with what its tasks derive from it and use again, and the tiles' states and sums put together.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "worker/label/cells.h"
#include "worker/label/unary.h"
#include "worker/photo/contour_term.h"
#include "worker/photo/data_term.h"
#include "worker/photo/face_sums.h"
#include "worker/refine/stepper.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_options.h"
#include "worker/tile/tile_views.h"

namespace tessera {

// The faces of one region as a mesh of their own, in the package's order.
struct RegionMesh {
  TriangleMesh mesh;                      // at the start, with the start's labels
  std::vector<uint32_t> vertices, faces;  // indices in the package
  std::vector<uint8_t> boundary;          // flags of vertices of which some faces are missing
  std::vector<Cell> cell;                 // LabelCellOf each face
};

// The state of all vertices and faces of a package between two steps.
struct TileSnapshot {
  // One entry a vertex of the package. `level_start` and `last_step` are empty between levels.
  std::vector<Eigen::Vector3d> positions, level_start;
  std::vector<Eigen::Vector3f> last_step;
  std::vector<int32_t> labels;  // one a face, as `confidence`
  std::vector<float> confidence;
  // Flags of vertices and faces that an update does not change; empty: none.
  std::vector<uint8_t> frozen_vertices, frozen_faces;
  std::string report = "{}";            // JSON of the tile itself
  int64_t compared = 0, different = 0;  // vertices and faces that several tiles have, and of them those that differ
  double farthest_m = 0;                // greatest distance of two different positions
  Eigen::Vector3d farthest_at = Eigen::Vector3d::Zero();
};

// A tile's views and their data term.
struct TileImages {
  const std::vector<TileView> views;
  const TileData data;
  DataTerm data_term;

  TileImages(const TilePackage& package, std::vector<TileView> opened, const TileRefineOptions& options)
      : views(std::move(opened)),
        data(MakeTileData(package, views, GeometryUsesLabels(package, options))),
        data_term(data.views, data.pairs, data.groups, &package.cells, options.data) {}
};

// Not thread-safe. Not movable: parts refer to others.
class TileWorkspace {
 public:
  explicit TileWorkspace(TilePackage package);
  TileWorkspace(const TileWorkspace&) = delete;
  TileWorkspace& operator=(const TileWorkspace&) = delete;

  // Of the package at `path`. Takes the workspace that an earlier task of this process left for the same content and
  // `options_key`, if it is still there. The caller owns it exclusively; when the pointer is dropped, it is kept for
  // the next task.
  static StatusOr<std::shared_ptr<TileWorkspace>> Open(const std::string& path, const std::string& options_key);

  const TilePackage& package() const { return package_; }

  // The views in the crops at `views_path`, opened at the first call. Errors as OpenTileViews.
  StatusOr<TileImages*> Images(const std::string& views_path, const TileRefineOptions& options);
  // Stepper of the solve region for steps of the core's vertices, with the labels and frozen vertices of `snapshot`.
  // Made again only when they change.
  Stepper& SolveStepper(const TileSnapshot& snapshot, const TileRefineOptions& options);
  // Frees the stepper and the buffers of the data term: no iteration comes soon.
  void EndIterations();

  // Made at the first call. All regions of a whole city are one.
  const RegionMesh& region(Region region);
  // Frees the region: it is not needed soon.
  void Forget(Region region);
  // Approximate memory.
  size_t bytes() const;
  // Faces of kCoreRegion and of kSampleRegion, by ascending global id, and flags of both.
  const std::vector<uint32_t>& core_faces() const { return core_faces_; }
  const std::vector<uint32_t>& sample_faces() const { return sample_faces_; }
  const std::vector<uint8_t>& measured() const { return measured_; }
  // Whether every face of the package is in the core and in all regions: the only tile of a job.
  bool whole() const { return whole_; }

  // Puts the states together; without states, the start. `frozen`: tiles of `states` that an update does not change; if
  // all are frozen, the other vertices are at the start. DATA_LOSS if a face of `region` (Region bits; 0: none is
  // required) or one of its corners is in no state, but for faces from id `first_new_face` on (-1: none).
  StatusOr<TileSnapshot> Assemble(const std::vector<StateSpans>& states, uint8_t region,
                                  const std::vector<int>& frozen = {}, int64_t first_new_face = -1);
  // Sums of the region's faces, from all tiles. DATA_LOSS if a face is missing that is not frozen
  // (TileSnapshot::frozen_faces).
  StatusOr<std::vector<FaceSums>> AssemblePhoto(const std::vector<TileSums>& sums, Region region,
                                                const std::vector<uint8_t>& frozen = {});
  StatusOr<ContourSums> AssembleContours(const std::vector<TileSums>& sums, Region region);
  StatusOr<FaceLikelihoods> AssembleLikelihoods(const std::vector<TileSums>& sums, Region region,
                                                const std::vector<uint8_t>& frozen = {});

  // The core's part of `snapshot`.
  TileState StateOf(const TileSnapshot& snapshot) const;

 private:
  // The package's faces or vertices by ascending global id.
  struct ById {
    std::vector<uint32_t> ids, places;
    explicit ById(const std::vector<uint32_t>& ids_of_places);
    // Calls found(i, place) for each of `others` (ascending) that is among the ids.
    template <class Found>
    void ForShared(std::span<const uint32_t> others, const Found& found) const {
      size_t at = 0;
      for (size_t i = 0; i < others.size(); ++i) {
        while (at < ids.size() && ids[at] < others[i]) ++at;
        if (at == ids.size()) return;
        if (ids[at] == others[i]) found(i, places[at]);
      }
    }
  };

  // The index in the region of each face of the package; kNone beyond it.
  std::vector<uint32_t> PlacesIn(const RegionMesh& part) const;

  TilePackage package_;
  ById faces_by_id_, vertices_by_id_;
  std::vector<uint32_t> core_faces_, core_vertices_, sample_faces_;
  std::vector<uint8_t> measured_;
  bool whole_ = true;
  std::map<uint8_t, RegionMesh> regions_;
  std::unique_ptr<TileImages> images_;
  std::string images_content_;
  struct LabelledStepper {
    std::vector<int32_t> labels;
    std::vector<uint8_t> frozen;
    std::optional<Stepper> stepper;  // made in place
  };
  std::unique_ptr<LabelledStepper> stepper_;
};

}  // namespace tessera
