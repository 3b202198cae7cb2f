// Stores change rasters as files passed between tasks.
#ifndef TESSERA_WORKER_TASKS_CHANGE_FILES_H_
#define TESSERA_WORKER_TASKS_CHANGE_FILES_H_

#include <string>

#include "common/base/status.h"
#include "worker/changes/change_raster.h"

namespace tessera {

Status WriteChangeRaster(const std::string& path, const ChangeRaster& raster);
StatusOr<ChangeRaster> ReadChangeRaster(const std::string& path);

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_CHANGE_FILES_H_
