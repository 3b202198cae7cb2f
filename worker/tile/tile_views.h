// The pixels of the views of tiles: read, undistorted and cropped once, for all steps of the refinement.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"
#include "worker/photo/data_term.h"
#include "worker/photo/stored_texels.h"
#include "worker/tile/tile_files.h"
#include "worker/visibility/image_window.h"
#include "worker/visibility/view_groups.h"

namespace tessera {

// The parts of images that are cropped for some tiles.
struct ViewWindows {
  struct Window {
    SceneView view;
    PixelRect rect;
  };
  std::vector<int> tiles;                  // ascending
  std::multimap<int32_t, Window> of_view;  // by index in the survey; several if one would be larger
  int classes = 0;                         // of likelihoods; 0: the scene has none
};

// Adds the windows of the package (TilePackage::view_rects; ReadTileViews suffices). `earlier`: a file of crops, or
// empty; windows that lie in one of its crops are left out. DATA_LOSS if this file is damaged or has no crops of the
// tile.
Status AddWindows(const TilePackage& package, const std::string& earlier, ViewWindows* windows);

// Reads the views from `scene_folder` one by one and writes their windows on all pyramid levels to `path`, an array
// file. Luminance is rounded to 1 / 65534, likelihoods to 1 / 255 (StoredTexels). As many images as fit ItemsAtOnce are
// in memory at a time. Errors as ReadLuminance and ReadLikelihoods; CANCELLED.
Status CropViews(const ViewWindows& windows, const std::string& scene_folder, const std::string& path,
                 const TaskControl& control);

// The views of `package` that have windows, read on demand, each from the first of the files of crops that contains its
// window. DATA_LOSS if a file is damaged or has no crops of the tile, or no file contains a window.
StatusOr<std::vector<RefineView>> OpenTileViews(const TilePackage& package, const std::vector<std::string>& paths);

// The pairs of the package whose views are both among `views`, as indices into these.
std::vector<ViewPair> PairsOf(const TilePackage& package, const std::vector<RefineView>& views);

// The selection of `views` for the package's cells.
ViewGroups GroupsOf(const TilePackage& package, const std::vector<RefineView>& views);

}  // namespace tessera
