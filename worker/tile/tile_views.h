// The pixels of a tile's views: read, undistorted, and cropped to what sees the tile, once for all parts of its
// refinement.
#ifndef TESSERA_WORKER_TILE_TILE_VIEWS_H_
#define TESSERA_WORKER_TILE_TILE_VIEWS_H_

#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"
#include "worker/photo/data_term.h"
#include "worker/photo/view_pixels.h"
#include "worker/tile/tile_files.h"
#include "worker/visibility/image_window.h"
#include "worker/visibility/view_groups.h"

namespace tessera {

struct TileView {
  int view = 0;                              // index in the package
  CameraWindow window;                       // on the tile
  std::shared_ptr<const ViewPixels> pixels;  // of the window
};

// Reads the views of a package from `scene_folder`, one after the other, and writes their windows
// (TilePackage::view_rects) on all levels to `path`, an array file; those of none are left out. Luminance is rounded to
// 1 / 65534, likelihoods to 1 / 255, as the data term has them (StoredTexels). One image is in memory at a time; the
// disk holds all crops twice meanwhile. Errors of the files as ReadLuminance and ReadLikelihoods; CANCELLED.
Status CropTileViews(const TilePackage& package, const std::string& scene_folder, const std::string& path,
                     const TaskControl& control);

// The crops of `package` in the file. They are read from it whenever they are asked for; nothing is held. DATA_LOSS if
// the file is damaged or of another package.
StatusOr<std::vector<TileView>> OpenTileViews(const TilePackage& package, const std::string& path);

// A plane a class, in [0, 1]; level.mapping says where.
FloatImage LikelihoodImage(const StoredTexels& level);

// The views as the data term takes them.
struct TileData {
  std::vector<RefineView> views;
  std::vector<ViewPair> pairs;
  ViewGroups groups;
};
TileData MakeTileData(const TilePackage& package, const std::vector<TileView>& views, bool knows_labels);

}  // namespace tessera

#endif  // TESSERA_WORKER_TILE_TILE_VIEWS_H_
