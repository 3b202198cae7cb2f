#include "common/exporting/raster/raster_formats.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/arrays/array_file.h"
#include "common/exporting/raster/geotiff.h"
#include "common/exporting/raster/raster_grid.h"
#include "common/exporting/raster/raster_map.h"
#include "common/exporting/raster/raster_pixels.h"
#include "common/exporting/raster/raster_vrt.h"
#include "common/exporting/raster/surface_raster.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

// The part file has the box of the sheet's file; empty if there is none.
constexpr char kBoxArray[] = "box";

Status WriteRasterPart(const std::string& folder, const RasterBox& box) {
  ArrayFile file;
  file.arrays[kBoxArray] = std::vector<int64_t>{box.x0, box.y0, box.width, box.height};
  return WriteArrayFile(absl::StrCat(folder, "/", kPartFile), file);
}

StatusOr<RasterBox> ReadRasterPart(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(ArrayFile file, ReadArrayFile(path));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<int64_t> box, file.Take<int64_t>(kBoxArray, 4));
  return RasterBox{box[0], box[1], static_cast<int>(box[2]), static_cast<int>(box[3])};
}

StatusOr<std::vector<std::string>> WriteRasterFiles(const SheetInput& input, const RasterMap& map, const RasterBox& box,
                                                    const RasterPixels& pixels, const std::string& folder) {
  std::vector<std::string> names;
  if (!pixels.HasData()) {
    TESSERA_RETURN_IF_ERROR(WriteRasterPart(folder, RasterBox()));
    return names;
  }
  const GeoTiffPlace place = {map.system(), box.Corner(map.pixel_size()), map.pixel_size()};
  TESSERA_ASSIGN_OR_RETURN(const std::string bytes,
                           EncodeGeoTiff(pixels, place, {input.scene.classes, input.set_aside}));
  if (!map.system().esri_wkt.empty()) {
    names.push_back(SheetName(input.id) + ".prj");
    TESSERA_RETURN_IF_ERROR(WriteFileAtomic(absl::StrCat(folder, "/", names.back()), map.system().esri_wkt + "\n"));
  }
  names.push_back(SheetName(input.id) + ".tif");
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(absl::StrCat(folder, "/", names.back()), bytes));
  TESSERA_RETURN_IF_ERROR(WriteRasterPart(folder, box));
  return names;
}

// Writes the files of a sheet whose pixels `fill` computes.
template <class Fill>
StatusOr<std::vector<std::string>> WriteRasterSheet(RasterContent content, const SheetInput& input,
                                                    const std::string& folder, const TaskControl& control,
                                                    const Fill& fill) {
  TESSERA_ASSIGN_OR_RETURN(const RasterMap map, RasterMap::Open(input.scene, input.options));
  TESSERA_ASSIGN_OR_RETURN(const SheetRaster raster, RasterizeSheet(input, map, control));
  RasterPixels pixels = EmptyRaster(content, raster.box.width, raster.box.height);
  TESSERA_RETURN_IF_ERROR(fill(map, raster, &pixels));
  TESSERA_RETURN_IF_ERROR(control.Check());
  return WriteRasterFiles(input, map, raster.box, pixels, folder);
}

// The points of the surface at the centres of the pixels in rows [row0, row1). Normals point up.
OrthoPoints PointsOfRows(const SheetRaster& raster, const RasterMap& map, const Eigen::Vector3d& up, int row0,
                         int row1) {
  const MeshSpans mesh(raster.surface.local, raster.surface.faces);
  OrthoPoints out;
  out.spacing_m = map.pixel_m();
  for (int row = row0; row < row1; ++row) {
    for (int column = 0; column < raster.box.width; ++column) {
      const size_t pixel = static_cast<size_t>(row) * raster.box.width + column;
      const int32_t face = raster.top.face[pixel];
      if (face < 0) continue;
      const Eigen::Vector3f normal = FaceNormal(mesh, face).cast<float>();
      out.pixels.push_back(pixel);
      out.points.push_back(PointOfPixel(raster.surface, face, column, row, raster.box, map.pixel_size()));
      out.normals.push_back(normal.dot(up.cast<float>()) < 0 ? Eigen::Vector3f(-normal) : normal);
    }
  }
  return out;
}

StatusOr<std::vector<std::string>> JoinRaster(RasterContent content, const std::string& name, const JoinInput& input,
                                              const std::string& folder, const TaskControl& control) {
  TESSERA_ASSIGN_OR_RETURN(const RasterMap map, RasterMap::Open(input.scene, input.options));
  std::vector<VrtSource> sources;
  for (const JoinInput::Item& item : input.sheets) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    TESSERA_ASSIGN_OR_RETURN(const RasterBox box, ReadRasterPart(item.part_path));
    if (box.pixels() > 0) sources.push_back({SheetName(item.id) + ".tif", box});
  }
  std::vector<std::string> names;
  if (sources.empty()) return names;
  names.push_back(name);
  TESSERA_RETURN_IF_ERROR(
      WriteFileAtomic(absl::StrCat(folder, "/", name), MosaicVrt(content, map, input.scene.classes, sources)));
  return names;
}

}  // namespace

Status CheckRaster(const ExportOptions& options, const ExportScene& scene) {
  return RasterMap::Open(scene, options).status();
}

Status CheckClassesRaster(const ExportOptions& options, const ExportScene& scene) {
  if (scene.classes.size() > kMaxRasterClasses) {
    return absl::InvalidArgumentError(absl::StrCat("formats: found classes for a scene with ", scene.classes.size(),
                                                   " classes, expected at most ", kMaxRasterClasses));
  }
  return CheckRaster(options, scene);
}

StatusOr<std::vector<std::string>> WriteDsmSheet(const SheetInput& input, const std::string& folder,
                                                 const TaskControl& control) {
  const auto fill = [](const RasterMap&, const SheetRaster& raster, RasterPixels* pixels) {
    for (size_t p = 0; p < pixels->heights.size(); ++p) {
      if (raster.top.face[p] >= 0) pixels->heights[p] = static_cast<float>(raster.top.height[p]);
    }
    return absl::OkStatus();
  };
  return WriteRasterSheet(RasterContent::kHeights, input, folder, control, fill);
}

StatusOr<std::vector<std::string>> WriteClassesSheet(const SheetInput& input, const std::string& folder,
                                                     const TaskControl& control) {
  const auto fill = [](const RasterMap&, const SheetRaster& raster, RasterPixels* pixels) {
    for (size_t p = 0; p < pixels->bytes.size(); ++p) {
      const int32_t face = raster.top.face[p];
      const int32_t label = face < 0 ? -1 : raster.surface.labels[face];
      if (label >= 0 && label < kMaxRasterClasses) pixels->bytes[p] = static_cast<uint8_t>(label);
    }
    return absl::OkStatus();
  };
  return WriteRasterSheet(RasterContent::kClasses, input, folder, control, fill);
}

StatusOr<std::vector<std::string>> WriteOrthoSheetWith(const OrthoColorer& colorer, const SheetInput& input,
                                                       const std::string& folder, const TaskControl& control) {
  const auto fill = [&](const RasterMap& map, const SheetRaster& raster, RasterPixels* pixels) -> Status {
    // Bounds memory: one call colours all pixels of a sheet, unless they are much smaller than the GSD.
    constexpr int kMaxPoints = 4'000'000;
    const int band = std::max(1, kMaxPoints / raster.box.width);
    for (int row = 0; row < raster.box.height; row += band) {
      const int end = std::min(row + band, raster.box.height);
      const OrthoPoints at = PointsOfRows(raster, map, input.scene.up, row, end);
      if (at.points.empty()) continue;
      std::vector<Rgb> colors;
      std::vector<uint8_t> seen;
      const double height = raster.box.height;
      TESSERA_RETURN_IF_ERROR(colorer(input, at, &colors, &seen, PartOf(control, row / height, end / height)));
      for (size_t k = 0; k < at.pixels.size(); ++k) {
        if (!seen[k]) continue;
        uint8_t* const out = &pixels->bytes[4 * at.pixels[k]];
        std::copy(colors[k].begin(), colors[k].end(), out);
        out[3] = 255;
      }
    }
    return absl::OkStatus();
  };
  return WriteRasterSheet(RasterContent::kColors, input, folder, control, fill);
}

StatusOr<std::vector<std::string>> JoinDsm(const JoinInput& input, const std::string& folder,
                                           const TaskControl& control) {
  return JoinRaster(RasterContent::kHeights, "dsm.vrt", input, folder, control);
}

StatusOr<std::vector<std::string>> JoinClasses(const JoinInput& input, const std::string& folder,
                                               const TaskControl& control) {
  return JoinRaster(RasterContent::kClasses, "classes.vrt", input, folder, control);
}

StatusOr<std::vector<std::string>> JoinOrtho(const JoinInput& input, const std::string& folder,
                                             const TaskControl& control) {
  return JoinRaster(RasterContent::kColors, "ortho.vrt", input, folder, control);
}

}  // namespace tessera
