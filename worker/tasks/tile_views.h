// The pixels of a tile's views: read, undistorted, and cropped to what sees the tile.
#ifndef TESSERA_WORKER_TASKS_TILE_VIEWS_H_
#define TESSERA_WORKER_TASKS_TILE_VIEWS_H_

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"
#include "worker/label/unary.h"
#include "worker/tasks/tile_files.h"
#include "worker/visibility/image_window.h"

namespace tessera {

struct TileView {
  int view = 0;            // index in the package
  CameraWindow window;     // on the tile
  FloatImage luminance;    // of the window
  FloatImage likelihoods;  // a plane a class; empty if the scene has none
  PixelMapping mapping;    // from the whole image to likelihoods
};

// Reads the views of a package from `scene_folder`; those that do not see the tile are left out. Errors of the files as
// ReadLuminance and ReadLikelihoods; CANCELLED.
StatusOr<std::vector<TileView>> LoadTileViews(const TilePackage& package, const std::string& scene_folder,
                                              const TaskControl& control);

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_TILE_VIEWS_H_
