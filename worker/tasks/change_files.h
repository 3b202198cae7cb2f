// Stores change rasters as files passed between tasks.
#pragma once

#include <string>

#include "common/base/status.h"
#include "worker/changes/change_raster.h"

namespace tessera {

Status WriteChangeRaster(const std::string& path, const ChangeRaster& raster);
StatusOr<ChangeRaster> ReadChangeRaster(const std::string& path);

}  // namespace tessera
