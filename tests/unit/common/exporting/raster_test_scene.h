// Sheets of small surfaces and a reader of the rasters made of them.
#pragma once

#include <geotiff/geotiff.h>
#include <geotiff/geotiffio.h>
#include <geotiff/xtiffio.h>
#include <gtest/gtest.h>
#include <tiffio.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <numbers>
#include <string>
#include <vector>

#include "common/exporting/export_format.h"
#include "common/exporting/raster/raster_grid.h"
#include "common/storage/files.h"

namespace tessera {

// Cells of 8 m: a sheet has a side of 128 m, with 0.5 m pixels 256 of them.
inline ExportScene RasterScene(const Crs& crs, const Eigen::Vector3d& near) {
  ExportScene scene;
  scene.frame = *Frame::Around(crs, near);
  scene.gsd_m = 0.5;
  scene.ground = MakeGroundPlane(scene.up, 8);
  scene.classes.resize(3);
  scene.classes[0].name = "ground";
  scene.classes[1].name = "<b a=\"1\">roof & 'wall'</b>\n]]>\x01";
  scene.classes[2].name = "tree";
  scene.classes[0].color_rgb = {10, 20, 30};
  scene.classes[1].color_rgb = {200, 100, 50};
  return scene;
}

inline ExportScene LocalRasterScene() { return RasterScene(Crs(), {0, 0, 0}); }

inline ExportScene UtmRasterScene() {
  Crs crs;
  crs.kind = Crs::Kind::kUtm;
  crs.zone = 33;
  return RasterScene(crs, {391234, 5820123, 40});
}

// East-north-up: at longitude 12, 3 degrees west of the meridian of zone 33, grid north is turned by 2.3 degrees.
inline ExportScene EnuRasterScene() {
  Crs crs;
  crs.kind = Crs::Kind::kEnu;
  crs.lat_rad = 50 * std::numbers::pi / 180;
  crs.lon_rad = 12 * std::numbers::pi / 180;
  return RasterScene(crs, {0, 0, 0});
}

// A grid of squares of `step_m` metres, [x0, x1] x [y0, y1] in local coordinates, of two faces each.
inline Sheet GridSheet(
    double x0, double y0, double x1, double y1, double step_m, const std::function<double(double x, double y)>& height,
    const std::function<int(double x, double y)>& label = [](double, double) { return 0; }) {
  const auto columns = static_cast<uint32_t>(std::lround((x1 - x0) / step_m));
  const auto rows = static_cast<uint32_t>(std::lround((y1 - y0) / step_m));
  Sheet sheet;
  for (uint32_t j = 0; j <= rows; ++j) {
    for (uint32_t i = 0; i <= columns; ++i) {
      const double x = x0 + step_m * i, y = y0 + step_m * j;
      sheet.vertices.emplace_back(x, y, height(x, y));
    }
  }
  for (uint32_t j = 0; j < rows; ++j) {
    for (uint32_t i = 0; i < columns; ++i) {
      const uint32_t a = j * (columns + 1) + i, b = a + 1, c = b + columns, d = c + 1;
      sheet.faces.push_back({a, b, c});
      sheet.faces.push_back({b, d, c});
      const int value = label(x0 + step_m * (i + 0.5), y0 + step_m * (j + 0.5));
      sheet.labels.insert(sheet.labels.end(), {value, value});
    }
  }
  return sheet;
}

// One image of a GeoTIFF: the first, or an overview.
struct ReadRasterImage {
  int width = 0, height = 0, samples = 0;
  std::vector<float> floats;
  std::vector<uint8_t> bytes;
  std::map<uint32_t, std::vector<double>> numbers;  // tags
  std::map<uint32_t, std::string> texts;
  std::vector<uint16_t> palette;  // red, green, blue, 256 each

  float At(int column, int row) const { return floats[static_cast<size_t>(row) * width + column]; }
  // The column and row of the pixel at coordinates of the system.
  std::pair<int, int> PixelAt(double x, double y) const {
    const std::vector<double>&scale = numbers.at(33550), &tie = numbers.at(33922);
    return {static_cast<int>(std::floor((x - tie[3]) / scale[0])),
            static_cast<int>(std::floor((tie[4] - y) / scale[1]))};
  }
  Eigen::Vector2d CentreOf(int column, int row) const {
    const std::vector<double>&scale = numbers.at(33550), &tie = numbers.at(33922);
    return {tie[3] + (column + 0.5) * scale[0], tie[4] - (row + 0.5) * scale[1]};
  }
};

inline ReadRasterImage ReadRasterPage(TIFF* tiff) {
  ReadRasterImage image;
  uint32_t width = 0, height = 0, tile_width = 0, tile_height = 0;
  uint16_t samples = 0, bits = 0;
  TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &width);
  TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &height);
  TIFFGetField(tiff, TIFFTAG_TILEWIDTH, &tile_width);
  TIFFGetField(tiff, TIFFTAG_TILELENGTH, &tile_height);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &samples);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &bits);
  image.width = static_cast<int>(width);
  image.height = static_cast<int>(height);
  image.samples = samples;
  for (const uint32_t tag : {TIFFTAG_COMPRESSION, TIFFTAG_PREDICTOR, TIFFTAG_PHOTOMETRIC, TIFFTAG_SAMPLEFORMAT}) {
    uint16_t value = 0;
    if (TIFFGetField(tiff, tag, &value)) image.numbers[tag] = {static_cast<double>(value)};
  }
  uint32_t type = 0;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SUBFILETYPE, &type);
  image.numbers[TIFFTAG_SUBFILETYPE] = {static_cast<double>(type)};
  image.numbers[TIFFTAG_TILEWIDTH] = {static_cast<double>(tile_width)};
  char* date = nullptr;
  if (TIFFGetField(tiff, TIFFTAG_DATETIME, &date)) image.texts[TIFFTAG_DATETIME] = date;
  uint16_t extra_count = 0, *extra = nullptr;
  if (TIFFGetField(tiff, TIFFTAG_EXTRASAMPLES, &extra_count, &extra)) {
    for (int k = 0; k < extra_count; ++k) image.numbers[TIFFTAG_EXTRASAMPLES].push_back(extra[k]);
  }
  for (const uint32_t tag : {33550u, 33922u}) {
    uint16_t count = 0;
    double* values = nullptr;
    if (TIFFGetField(tiff, tag, &count, &values)) image.numbers[tag].assign(values, values + count);
  }
  for (const uint32_t tag : {42112u, 42113u}) {
    uint32_t count = 0;
    char* text = nullptr;
    if (TIFFGetField(tiff, tag, &count, &text)) image.texts[tag] = text;
  }
  uint16_t* colors[3] = {};
  if (TIFFGetField(tiff, TIFFTAG_COLORMAP, &colors[0], &colors[1], &colors[2])) {
    for (const uint16_t* channel : colors) image.palette.insert(image.palette.end(), channel, channel + 256);
  }
  const size_t pixel_bytes = size_t{samples} * bits / 8;
  std::vector<uint8_t> all(pixel_bytes * width * height), tile(TIFFTileSize(tiff));
  for (uint32_t y0 = 0; y0 < height; y0 += tile_height) {
    for (uint32_t x0 = 0; x0 < width; x0 += tile_width) {
      EXPECT_GE(TIFFReadTile(tiff, tile.data(), x0, y0, 0, 0), 0);
      for (uint32_t y = y0; y < std::min(height, y0 + tile_height); ++y) {
        std::memcpy(&all[pixel_bytes * (size_t{y} * width + x0)], &tile[pixel_bytes * tile_width * (y - y0)],
                    pixel_bytes * std::min(tile_width, width - x0));
      }
    }
  }
  if (bits == 32) {
    image.floats.resize(all.size() / 4);
    std::memcpy(image.floats.data(), all.data(), all.size());
  } else {
    image.bytes = std::move(all);
  }
  return image;
}

struct ReadRasterFile {
  std::vector<ReadRasterImage> images;   // the first, then overviews
  int minor_revision = -1;               // of GeoTIFF: 1.0 or 1.1
  std::map<int, int> keys;               // GeoKeys with one number
  std::map<int, std::string> key_texts;  // GeoKeys with text
};

inline ReadRasterFile ReadRaster(const std::string& path) {
  ReadRasterFile file;
  TIFFSetWarningHandler(nullptr);
  TIFF* const tiff = XTIFFOpen(path.c_str(), "r");
  if (tiff == nullptr) {
    ADD_FAILURE() << path << " is no TIFF";
    return file;
  }
  GTIF* const keys = GTIFNew(tiff);
  int versions[3] = {};
  GTIFDirectoryInfo(keys, versions, nullptr);
  file.minor_revision = versions[2];
  for (const geokey_t key : {GTModelTypeGeoKey, GTRasterTypeGeoKey, GeographicTypeGeoKey, ProjectedCSTypeGeoKey,
                             ProjLinearUnitsGeoKey, VerticalCSTypeGeoKey, VerticalUnitsGeoKey}) {
    uint16_t value = 0;
    if (GTIFKeyGetSHORT(keys, key, &value, 0, 1) == 1) file.keys[key] = value;
  }
  for (const geokey_t key : {GTCitationGeoKey, PCSCitationGeoKey}) {
    char text[4096] = {};
    if (GTIFKeyGetASCII(keys, key, text, sizeof text) > 0) file.key_texts[key] = text;
  }
  GTIFFree(keys);
  do {
    file.images.push_back(ReadRasterPage(tiff));
  } while (TIFFReadDirectory(tiff));
  XTIFFClose(tiff);
  return file;
}

// Inputs of formats, still without sheets. Members that other formats add stay empty.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
inline SheetInput RasterInput(const ExportScene& scene, const ExportOptions& options, const SheetId& id) {
  return {.scene = scene, .options = options, .id = id};
}
inline JoinInput RasterJoin(const ExportScene& scene, const ExportOptions& options) {
  return {.scene = scene, .options = options};
}
#pragma GCC diagnostic pop

// Calls the function of a format for one sheet; the file is in `folder` then.
inline StatusOr<std::vector<std::string>> WriteRaster(const ExportScene& scene, const ExportOptions& options,
                                                      const SheetId& id, const Sheet& sheet,
                                                      const std::vector<Sheet>& neighbours, const std::string& format,
                                                      const std::string& folder) {
  SheetInput input = RasterInput(scene, options, id);
  input.sheet = sheet;
  input.neighbours = neighbours;
  return FindExportFormat(format)->write_sheet(input, folder, {});
}

}  // namespace tessera
