// The pixels of a tile's views: read, undistorted and cropped to the tile once, for all steps of its refinement.
#pragma once

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

// Reads the views of a package from `scene_folder` one by one and writes their windows (TilePackage::view_rects) on
// all pyramid levels to `path`, an array file. Views without a window are skipped. Luminance is rounded to 1 / 65534,
// likelihoods to 1 / 255 (StoredTexels). One image is in memory at a time; the disk temporarily holds all crops
// twice. Errors as ReadLuminance and ReadLikelihoods; CANCELLED.
Status CropTileViews(const TilePackage& package, const std::string& scene_folder, const std::string& path,
                     const TaskControl& control);

// The crops of `package` in the file, read on demand. DATA_LOSS if the file is damaged or belongs to another package.
StatusOr<std::vector<RefineView>> OpenTileViews(const TilePackage& package, const std::string& path);

// The pairs of the package whose views are both among `views`, as indices into these.
std::vector<ViewPair> PairsOf(const TilePackage& package, const std::vector<RefineView>& views);

// The selection of `views` for the package's cells.
ViewGroups GroupsOf(const TilePackage& package, const std::vector<RefineView>& views);

}  // namespace tessera
