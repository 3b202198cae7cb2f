// The format `changes`: changes.geojson of an update in another coordinate reference system.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/export_format.h"

namespace tessera {

// ExportFormat::join. Without ExportOptions::crs it copies the file: WGS 84 longitude and latitude (RFC 7946), or the
// scene's coordinates if it has no coordinate reference system. Else coordinates are in that system, and an EPSG code
// is named by a member "crs" as of GeoJSON 2008, which GDAL and QGIS read. INVALID_ARGUMENT if there is no
// changes.geojson or it is damaged.
StatusOr<std::vector<std::string>> JoinChanges(const JoinInput& input, const std::string& folder,
                                               const TaskControl& control);

}  // namespace tessera
