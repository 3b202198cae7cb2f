// The formats dsm, classes and ortho: a GeoTIFF for each sheet, and a VRT of all.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/export_format.h"
#include "common/exporting/sheet.h"

namespace tessera {

// Refuses what no sheet can have: errors of RasterMap::Open; for `classes`, more classes than a byte has values.
Status CheckRaster(const ExportOptions& options, const ExportScene& scene);
Status CheckClassesRaster(const ExportOptions& options, const ExportScene& scene);

// Each writes `X_Y.tif` and, if the system has no EPSG code, `X_Y.prj` to `folder`, and kPartFile. No file if the sheet
// has no pixel with data. A pixel has the value of the highest surface at its centre, of this sheet's faces and its
// neighbours'; pixels of other sheets (PixelsOfSheet) and without a face have no data.
// dsm: the height in the system. classes: the index of the face's class; no data if it has none. ortho: the colour of
// the surface from the photographs; no data if no photograph shows it.
StatusOr<std::vector<std::string>> WriteDsmSheet(const SheetInput& input, const std::string& folder,
                                                 const TaskControl& control);
StatusOr<std::vector<std::string>> WriteClassesSheet(const SheetInput& input, const std::string& folder,
                                                     const TaskControl& control);

// Points of the surface: one a pixel.
struct OrthoPoints {
  std::vector<size_t> pixels;            // their indices in the raster
  std::vector<Eigen::Vector3d> points;   // metres, local frame
  std::vector<Eigen::Vector3f> normals;  // unit vectors, upwards
  double spacing_m = 0;                  // the pixels' size
};
// Computes the colours of the points. `seen`: 0 if no photograph shows the point.
using OrthoColorer = std::function<Status(const SheetInput& input, const OrthoPoints& at, std::vector<Rgb>* colors,
                                          std::vector<uint8_t>* seen, const TaskControl& control)>;
StatusOr<std::vector<std::string>> WriteOrthoSheetWith(const OrthoColorer& colorer, const SheetInput& input,
                                                       const std::string& folder, const TaskControl& control);

// Each writes `dsm.vrt`, `classes.vrt` or `ortho.vrt`, which names the files of the sheets in the same folder. None
// without files.
StatusOr<std::vector<std::string>> JoinDsm(const JoinInput& input, const std::string& folder,
                                           const TaskControl& control);
StatusOr<std::vector<std::string>> JoinClasses(const JoinInput& input, const std::string& folder,
                                               const TaskControl& control);
StatusOr<std::vector<std::string>> JoinOrtho(const JoinInput& input, const std::string& folder,
                                             const TaskControl& control);

}  // namespace tessera
