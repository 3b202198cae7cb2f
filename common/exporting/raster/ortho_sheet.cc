#include "common/exporting/raster/ortho_sheet.h"

#include "common/exporting/color/point_colors.h"
#include "common/exporting/raster/raster_formats.h"

namespace tessera {
namespace {

Status OrthoColors(const SheetInput& input, const OrthoPoints& at, std::vector<Rgb>* colors, std::vector<uint8_t>* seen,
                   const TaskControl& control) {
  std::vector<MeshSpans> occluders = {input.sheet.mesh()};
  for (const Sheet& sheet : input.neighbours) occluders.push_back(sheet.mesh());
  const std::vector<float> spacing_m(at.points.size(), static_cast<float>(at.spacing_m));
  PointColorInput points;
  points.points = at.points;
  points.normals = at.normals;
  points.occluders = occluders;
  points.views = input.views;
  points.view_files = input.view_files;
  points.mask_files = input.mask_files;
  points.spacing_m = spacing_m;
  return ColorPoints(points, colors, seen, control);
}

}  // namespace

StatusOr<std::vector<std::string>> WriteOrthoSheet(const SheetInput& input, const std::string& folder,
                                                   const TaskControl& control) {
  return WriteOrthoSheetWith(OrthoColors, input, folder, control);
}

}  // namespace tessera
