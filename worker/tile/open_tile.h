// A tile's package with what its tasks make of it again and again, and what the tiles' states and sums say together.
#ifndef TESSERA_WORKER_TILE_OPEN_TILE_H_
#define TESSERA_WORKER_TILE_OPEN_TILE_H_

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <memory>
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
  std::vector<uint32_t> vertices, faces;  // of each, which of the package's it is
  std::vector<uint8_t> fixed;             // vertices: 1 where some of the faces about it are missing
  std::vector<Cell> cell;                 // LabelCellOf each face
};

// What is known of the package at a moment.
struct KnownState {
  // Of the package's vertices; those of a level are empty between levels.
  std::vector<Eigen::Vector3d> positions, level_start;
  std::vector<Eigen::Vector3f> last_step;
  std::vector<int32_t> labels;  // of its faces
  std::vector<float> confidence;
  // Flags of vertices and faces of tiles that an update leaves as they are; empty: none.
  std::vector<uint8_t> held_vertices, held_faces;
  std::string report = "{}";            // the tile's own
  int64_t compared = 0, different = 0;  // vertices that several tiles have; those of which the bytes differ
  double farthest_m = 0;                // of two different ones
  Eigen::Vector3d farthest_at = Eigen::Vector3d::Zero();
};

// A tile's views and the data terms that look at them.
struct TileSight {
  const std::vector<TileView> views;
  const TileData data;
  DataTerm data_term;

  TileSight(const TilePackage& package, std::vector<TileView> opened, const TileRefineOptions& options)
      : views(std::move(opened)),
        data(MakeTileData(package, views, GeometryKnowsLabels(package, options))),
        data_term(data.views, data.pairs, data.groups, &package.cells, options.geometry) {}
};

// Not thread-safe. Not movable: parts refer to others.
class OpenTile {
 public:
  explicit OpenTile(TilePackage package);
  OpenTile(const OpenTile&) = delete;
  OpenTile& operator=(const OpenTile&) = delete;

  // Of the package at `path`; as this process left it, if it worked on the same content with the same options (by their
  // key) not long ago. Whoever has it has it alone, and leaves it by letting go of it.
  static StatusOr<std::shared_ptr<OpenTile>> Open(const std::string& path, const std::string& options_key);

  const TilePackage& package() const { return package_; }

  // Of the crops at `views_path`; opened when first asked for. Errors as OpenTileViews'.
  StatusOr<TileSight*> Sight(const std::string& views_path, const TileRefineOptions& options);
  // Of the solve region's mesh with these labels of its faces, for steps of the core's vertices; made anew only when
  // they change. `held`: flags of its vertices (KnownState).
  Stepper& SolveStepper(const std::vector<int32_t>& labels, const std::vector<uint8_t>& held,
                        const TileRefineOptions& options);

  // Made when first asked for.
  const RegionMesh& region(Region region);
  // Drops what is kept of a region: it is not needed soon.
  void Forget(Region region);
  // What is kept, about.
  size_t bytes() const;
  // The core's.
  const std::vector<uint32_t>& core_faces() const { return core_faces_; }
  const std::vector<uint32_t>& core_vertices() const { return core_vertices_; }
  const std::vector<uint32_t>& sample_faces() const { return sample_faces_; }  // kSampleRegion's, likewise
  std::vector<uint8_t> measured() const;  // flags of the core's faces and the sample's

  // The start where there are no states, else what they say; DATA_LOSS if they do not say it of every face in
  // `region` (0: of all that is in sight) and its corners. `held`: tiles of `states` that are left as they are;
  // where there are no others, all else is at the start.
  // Faces from id `first_new_face` on may be in no state; -1: none may.
  StatusOr<KnownState> Join(const std::vector<StateSpans>& states, uint8_t region, const std::vector<int>& held = {},
                            int64_t first_new_face = -1);
  // Sums of every face of the region; none of `held` ones (KnownState::held_faces). DATA_LOSS if another is missing.
  StatusOr<std::vector<FaceSums>> JoinPhoto(const std::vector<TileSums>& sums, Region region,
                                            const std::vector<uint8_t>& held = {});
  StatusOr<ContourSums> JoinContours(const std::vector<TileSums>& sums, Region region);
  StatusOr<FaceLikelihoods> JoinLikelihoods(const std::vector<TileSums>& sums, Region region,
                                            const std::vector<uint8_t>& held = {});

  // The core's part of `known`.
  TileState StateOf(const KnownState& known) const;

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

  // Of the package's faces, their places in the region; kNone beyond it.
  std::vector<uint32_t> PlacesIn(const RegionMesh& part) const;

  TilePackage package_;
  ById faces_by_id_, vertices_by_id_;
  std::vector<uint32_t> core_faces_, core_vertices_, sample_faces_;
  std::map<uint8_t, RegionMesh> regions_;
  std::unique_ptr<TileSight> sight_;
  std::string sight_content_;
  struct LabelledStepper {
    std::vector<int32_t> labels;
    std::vector<uint8_t> held;
    Stepper stepper;
  };
  std::unique_ptr<LabelledStepper> stepper_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_TILE_OPEN_TILE_H_
