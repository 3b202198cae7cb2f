// A tile's package with data that its tasks derive and reuse; assembles the states and sums of tiles.
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
#include "worker/city/id_merge.h"
#include "worker/label/cells.h"
#include "worker/label/unary.h"
#include "worker/photo/contour_term.h"
#include "worker/photo/data_term.h"
#include "worker/photo/face_sums.h"
#include "worker/refine/stepper.h"
#include "worker/tile/methods.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_views.h"

namespace tessera {

// The faces of a region as a mesh, in the package's order.
struct RegionMesh {
  StartSurface surface;                   // with the start's labels
  std::vector<uint32_t> vertices, faces;  // indices in the package
  std::vector<uint8_t> boundary;          // flags of vertices that have faces outside the region
  std::vector<Cell> cell;                 // LabelCellOf, per face
  const TriangleMesh& mesh() const { return surface.mesh(); }
};

// The state of all vertices and faces of a package between two steps.
struct TileSnapshot {
  uint8_t covered = 0xff;  // Region bits: the states have all faces of these regions and their corners
  // Per vertex of the package. `level_start` and `last_step` are empty between levels.
  std::vector<Eigen::Vector3d> positions, level_start;
  std::vector<Eigen::Vector3f> last_step;
  std::vector<int32_t> labels;  // per face, like `confidence`
  std::vector<float> confidence;
  // Flags of vertices and faces that an update does not change; empty: none.
  std::vector<uint8_t> frozen_vertices, frozen_faces;
  std::string report = "{}";            // the tile's own report, JSON
  int64_t compared = 0, different = 0;  // elements that several tiles have; those that differ
  double farthest_m = 0;                // largest distance between different positions of a vertex
  Eigen::Vector3d farthest_at = Eigen::Vector3d::Zero();
};

// Guard and repair of a region's mesh, for all levels. Refers to the region.
struct RegionRepair {
  MotionGuard guard;
  SurfaceRepair repair;
  RegionRepair(const RegionMesh& region, const MotionLimits& limits)
      : guard(region.surface, region.boundary, limits), repair(region.mesh(), guard.faces_of_vertex()) {}
};

// An assembled snapshot, for the next task that reads the same states.
class KeptSnapshot {
 public:
  // `states_key`: identifies the states and the other arguments of Assemble except the region (ContentsKey).
  void Keep(std::string states_key, TileSnapshot snapshot);
  // The snapshot, if its key is `states_key` and its states cover `region`. Forgets it in any case.
  std::optional<TileSnapshot> Take(const std::string& states_key, uint8_t region);
  bool empty() const { return !snapshot_; }

 private:
  std::string states_key_;
  std::optional<TileSnapshot> snapshot_;
};

// A tile's views and their data term.
struct TileImages {
  const std::vector<RefineView> views;
  const std::vector<ViewPair> pairs;
  const ViewGroups groups;
  DataTerm data_term;
  TriangleMesh surface;  // buffer of Measure: the package's mesh at the positions of a step

  TileImages(const TilePackage& package, std::vector<RefineView> opened, const TileRefineOptions& options)
      : views(std::move(opened)),
        pairs(PairsOf(package, views)),
        groups(GroupsOf(package, views)),
        data_term(views, pairs, groups, &package.cells, GeometryUsesLabels(package, options), options.data) {}
};

// Not thread-safe. Not movable: members refer to each other.
class TileWorkspace {
 public:
  explicit TileWorkspace(TilePackage package);
  TileWorkspace(const TileWorkspace&) = delete;
  TileWorkspace& operator=(const TileWorkspace&) = delete;

  // The workspace of the package at `path`. Reuses that of an earlier task of this process with the same content and
  // `options_key`, if it is still in memory. The caller owns it exclusively; its release returns it for later tasks.
  // Thread-safe. Errors as ReadTilePackage.
  static StatusOr<std::shared_ptr<TileWorkspace>> Open(const std::string& path, const std::string& options_key);

  const TilePackage& package() const { return package_; }

  // The views of the crops at these paths, opened at the first call. Errors as OpenTileViews.
  StatusOr<TileImages*> Images(const std::vector<std::string>& crop_paths, const TileRefineOptions& options);
  // Stepper of the solve region that moves the core's vertices, with the labels and frozen vertices of `snapshot`. Made
  // again only if the frozen vertices change.
  Stepper& SolveStepper(const TileSnapshot& snapshot, const TileRefineOptions& options);
  // Frees the stepper and the buffers of the data term. Call if no iteration follows soon.
  void EndIterations();

  // Made at the first call. If whole(), all regions are the same mesh.
  const RegionMesh& region(Region region);
  // Frees the region's mesh.
  void Forget(Region region);
  // Repair of the repair region, made at the first call and kept for the next levels. Null if that would take too much
  // of the memory of idle workspaces: the caller then repairs a part of the region and forgets it.
  RegionRepair* KeptRepair(const StepperOptions& options);
  // Approximate memory.
  size_t bytes() const;
  // Faces of kCoreRegion and of kSampleRegion, by ascending global id, and flags of both.
  const std::vector<uint32_t>& core_faces() const { return core_faces_; }
  const std::vector<uint32_t>& sample_faces() const { return sample_faces_; }
  const std::vector<uint8_t>& measured() const { return measured_; }
  // Whether every face of the package is in the core and in all regions: the only tile of a job.
  bool whole() const { return whole_; }

  // Combines the states; without states, the start. `frozen`: tiles of `states` that do not change; if all of them are
  // frozen, the other vertices are at the start. DATA_LOSS if a face of `region` (Region bits; 0: none) or one of its
  // corners is in no state, except faces with ids from `first_new_face` (-1: none).
  StatusOr<TileSnapshot> Assemble(const std::vector<StateSpans>& states, uint8_t region,
                                  const std::vector<int>& frozen = {}, int64_t first_new_face = -1);
  // What Assemble returned to an earlier task.
  KeptSnapshot& kept_snapshot() { return snapshot_; }
  // Sums of the region's faces, from all tiles. DATA_LOSS if a face is in no sums, unless it is flagged in `frozen`
  // (TileSnapshot::frozen_faces).
  StatusOr<std::vector<FaceSums>> AssemblePhoto(const SumsOfTiles& sums, Region region,
                                                const std::vector<uint8_t>& frozen = {});
  StatusOr<ContourSums> AssembleContours(const SumsOfTiles& sums, Region region);
  StatusOr<FaceLikelihoods> AssembleLikelihoods(const SumsOfTiles& sums, Region region,
                                                const std::vector<uint8_t>& frozen = {});

  // The part of `snapshot` in the core.
  TileState StateOf(const TileSnapshot& snapshot) const;

 private:
  // The package's faces or vertices by ascending global id.
  struct ById {
    std::vector<uint32_t> ids, places;
    explicit ById(const std::vector<uint32_t>& ids_of_places);
    // Calls found(i, place) for each id others[i] (ascending) that the package has.
    template <class Found>
    void ForShared(std::span<const uint32_t> others, const Found& found) const {
      ForSharedIds(others, ids, [&](size_t i, size_t at) { found(i, places[at]); });
    }
  };

  // Calls take(tile, i, face) for each face of `part` (index in it) that is face i of one of the sums; it returns
  // whether they have it. DATA_LOSS if a face without a flag in `frozen` is missing.
  template <class Take>
  Status AssembleFaces(const SumsOfTiles& sums, const RegionMesh& part, const char* what,
                       const std::vector<uint8_t>& frozen, const Take& take) const;

  // Per face of the package: its index in the region, or kNone.
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
    std::optional<Stepper> stepper;  // constructed in place
  };
  std::unique_ptr<LabelledStepper> stepper_;
  std::unique_ptr<RegionRepair> repair_;  // refers to its region
  KeptSnapshot snapshot_;
};

// Drops workspaces that TileWorkspace::Open keeps, down to the bound on their memory. The most recently used one may
// exceed it until a call of this or of Open. Thread-safe.
void TrimIdleWorkspaces();

// Identifies the contents of the files at `paths`. NOT_FOUND if one does not exist.
StatusOr<std::string> ContentsKey(const std::vector<std::string>& paths);

}  // namespace tessera
