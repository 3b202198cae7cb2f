#include "common/exporting/raster/geotiff.h"

#include <geotiff/geotiff.h>
#include <geotiff/geotiffio.h>
#include <geotiff/xtiffio.h>
#include <tiffio.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <memory>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/printable.h"
#include "common/storage/xml_file.h"

namespace tessera {
namespace {

constexpr int kRasterTile = 256;  // pixels
constexpr int kLastOverview = 16;
constexpr uint32_t kGdalMetadataTag = 42112, kGdalNoDataTag = 42113;

// Tags that libtiff does not know. They are merged into each directory; XTIFFInitialize would change libtiff for the
// whole process, and not safely in threads.
const std::array<TIFFFieldInfo, 7> kRasterTags = {{
    {TIFFTAG_GEOPIXELSCALE, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, const_cast<char*>("GeoPixelScale")},
    {TIFFTAG_GEOTIEPOINTS, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, const_cast<char*>("GeoTiePoints")},
    {TIFFTAG_GEOKEYDIRECTORY, -1, -1, TIFF_SHORT, FIELD_CUSTOM, 1, 1, const_cast<char*>("GeoKeyDirectory")},
    {TIFFTAG_GEODOUBLEPARAMS, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, const_cast<char*>("GeoDoubleParams")},
    {TIFFTAG_GEOASCIIPARAMS, -1, -1, TIFF_ASCII, FIELD_CUSTOM, 1, 0, const_cast<char*>("GeoASCIIParams")},
    {kGdalMetadataTag, -1, -1, TIFF_ASCII, FIELD_CUSTOM, 1, 0, const_cast<char*>("GDALMetadata")},
    {kGdalNoDataTag, -1, -1, TIFF_ASCII, FIELD_CUSTOM, 1, 0, const_cast<char*>("GDALNoDataValue")},
}};

struct GeoTiffCloser {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
  void operator()(GTIF* keys) const { GTIFFree(keys); }
};
using GeoTiffFile = std::unique_ptr<TIFF, GeoTiffCloser>;

// A file in memory, for libtiff.
struct GeoTiffMemory {
  std::string bytes;
  size_t position = 0;
  std::string error;  // the first

  static tmsize_t Read(thandle_t handle, void* out, tmsize_t count) {
    GeoTiffMemory& m = *static_cast<GeoTiffMemory*>(handle);
    const size_t left = m.position < m.bytes.size() ? m.bytes.size() - m.position : 0;
    const size_t n = std::min(left, static_cast<size_t>(count));
    if (n > 0) std::memcpy(out, m.bytes.data() + m.position, n);
    m.position += n;
    return static_cast<tmsize_t>(n);
  }
  static tmsize_t Write(thandle_t handle, void* in, tmsize_t count) {
    GeoTiffMemory& m = *static_cast<GeoTiffMemory*>(handle);
    const size_t end = m.position + static_cast<size_t>(count);
    if (end > m.bytes.size()) m.bytes.resize(end);
    std::memcpy(m.bytes.data() + m.position, in, static_cast<size_t>(count));
    m.position = end;
    return count;
  }
  static toff_t Seek(thandle_t handle, toff_t offset, int whence) {
    GeoTiffMemory& m = *static_cast<GeoTiffMemory*>(handle);
    m.position = offset + (whence == SEEK_CUR ? m.position : whence == SEEK_END ? m.bytes.size() : 0);
    return m.position;
  }
  static int Close(thandle_t) { return 0; }
  static toff_t Size(thandle_t handle) { return static_cast<GeoTiffMemory*>(handle)->bytes.size(); }
  static int KeepError(TIFF*, void* user, const char*, const char* format, va_list arguments) {
    std::string& error = static_cast<GeoTiffMemory*>(user)->error;
    if (!error.empty()) return 1;
    char text[256];
    std::vsnprintf(text, sizeof text, format, arguments);
    error = text;
    return 1;
  }

  GeoTiffFile Open() {
    TIFFOpenOptions* options = TIFFOpenOptionsAlloc();
    TIFFOpenOptionsSetErrorHandlerExtR(options, KeepError, this);
    GeoTiffFile tiff(
        TIFFClientOpenExt("memory", "wl", this, Read, Write, Seek, Close, Size, nullptr, nullptr, options));
    TIFFOpenOptionsFree(options);
    return tiff;
  }
};

// EPSG's code of a unit of length; 0: none.
int RasterUnitCode(double unit_m) {
  if (unit_m == 1) return 9001;
  if (unit_m == 0.3048) return 9002;
  return std::abs(unit_m - 1200.0 / 3937) < 1e-12 ? 9003 : 0;
}

void SetRasterShortKey(GTIF* keys, geokey_t key, int value) {
  GTIFKeySet(keys, key, TYPE_SHORT, 1, static_cast<int>(value));
}

void SetRasterTextKey(GTIF* keys, geokey_t key, const std::string& text) {
  GTIFKeySet(keys, key, TYPE_ASCII, static_cast<int>(text.size()) + 1, text.c_str());
}

void SetSystemKeys(GTIF* keys, const RasterSystem& system, RasterContent content) {
  constexpr int kUserDefined = 32767;
  SetRasterShortKey(keys, GTRasterTypeGeoKey, RasterPixelIsArea);
  SetRasterTextKey(keys, GTCitationGeoKey, Printable(system.name));
  const int unit = RasterUnitCode(system.unit_m), height_unit = RasterUnitCode(system.height_unit_m);
  if (system.epsg == 0) {
    SetRasterShortKey(keys, GTModelTypeGeoKey, kUserDefined);
    if (!system.esri_wkt.empty()) SetRasterTextKey(keys, PCSCitationGeoKey, "ESRI PE String = " + system.esri_wkt);
    if (system.kind == RasterSystem::Kind::kLocal) SetRasterShortKey(keys, ProjLinearUnitsGeoKey, unit);
  } else if (system.kind == RasterSystem::Kind::kGeographic) {
    SetRasterShortKey(keys, GTModelTypeGeoKey, ModelTypeGeographic);
    SetRasterShortKey(keys, GeographicTypeGeoKey, system.epsg);
  } else {
    SetRasterShortKey(keys, GTModelTypeGeoKey, ModelTypeProjected);
    SetRasterShortKey(keys, ProjectedCSTypeGeoKey, system.epsg);
    if (unit != 0) SetRasterShortKey(keys, ProjLinearUnitsGeoKey, unit);
  }
  if (content != RasterContent::kHeights || system.epsg == 0 || system.vertical_epsg == 0) return;
  GTIFSetVersionNumbers(keys, GEOTIFF_SPEC_1_1_VERSION, GEOTIFF_SPEC_1_1_KEY_REVISION,
                        GEOTIFF_SPEC_1_1_MINOR_REVISION);  // the first with EPSG's codes of vertical systems
  SetRasterShortKey(keys, VerticalCSTypeGeoKey, system.vertical_epsg);
  if (height_unit != 0) SetRasterShortKey(keys, VerticalUnitsGeoKey, height_unit);
}

// Of the main image alone.
Status SetPlaceTags(TIFF* tiff, RasterContent content, const GeoTiffPlace& place) {
  const double scale[3] = {place.pixel_size.x(), place.pixel_size.y(), 0};
  const double tie[6] = {0, 0, 0, place.corner.x(), place.corner.y(), 0};
  TIFFSetField(tiff, TIFFTAG_GEOPIXELSCALE, 3, scale);
  TIFFSetField(tiff, TIFFTAG_GEOTIEPOINTS, 6, tie);
  const std::unique_ptr<GTIF, GeoTiffCloser> keys(GTIFNew(tiff));
  if (keys == nullptr) return absl::InternalError("libgeotiff has no memory");
  SetSystemKeys(keys.get(), place.system, content);
  if (!GTIFWriteKeys(keys.get())) return absl::InternalError("libgeotiff cannot write the keys");
  return absl::OkStatus();
}

std::string MetadataItem(const std::string& name, const std::string& role, const std::string& text, bool of_band) {
  return absl::StrCat("<Item name=\"", name, "\"", of_band ? " sample=\"0\"" : "", role.empty() ? "" : " role=\"", role,
                      role.empty() ? "" : "\"", ">", EscapeMarkup(text), "</Item>");
}

// GDAL's metadata.
std::string RasterMetadata(RasterContent content, const RasterSystem& system, const GeoTiffText& text) {
  std::string xml = "<GDALMetadata>";
  if (text.quarantined) absl::StrAppend(&xml, MetadataItem("QUARANTINED", "", "YES", false));
  if (content == RasterContent::kHeights) {
    absl::StrAppend(&xml, MetadataItem("DESCRIPTION", "description", "height of the surface", true),
                    MetadataItem("UNITTYPE", "unittype", RasterUnitName(system.height_unit_m), true));
  }
  if (content == RasterContent::kClasses) {
    absl::StrAppend(&xml, MetadataItem("DESCRIPTION", "description", "class", true));
    for (size_t c = 0; c < text.classes.size(); ++c) {
      absl::StrAppend(&xml, MetadataItem(absl::StrCat("CLASS_", c), "", text.classes[c].name, true));
    }
  }
  return absl::StrCat(xml, "</GDALMetadata>\n");
}

void SetPixelTags(TIFF* tiff, const RasterPixels& pixels, const GeoTiffText& text) {
  const RasterContent content = pixels.content;
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, static_cast<uint32_t>(pixels.width));
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, static_cast<uint32_t>(pixels.height));
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, pixels.samples());
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, content == RasterContent::kHeights ? 32 : 8);
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT,
               content == RasterContent::kHeights ? SAMPLEFORMAT_IEEEFP : SAMPLEFORMAT_UINT);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  TIFFSetField(tiff, TIFFTAG_ORIENTATION, ORIENTATION_TOPLEFT);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_ADOBE_DEFLATE);
  TIFFSetField(tiff, TIFFTAG_PREDICTOR,
               content == RasterContent::kHeights ? PREDICTOR_FLOATINGPOINT : PREDICTOR_HORIZONTAL);
  TIFFSetField(tiff, TIFFTAG_TILEWIDTH, kRasterTile);
  TIFFSetField(tiff, TIFFTAG_TILELENGTH, kRasterTile);
  switch (content) {
    case RasterContent::kHeights:
      TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
      TIFFSetField(tiff, kGdalNoDataTag, absl::StrCat(kNoHeight).c_str());
      break;
    case RasterContent::kClasses: {
      constexpr uint16_t kScale = 257;  // of 8 bits to 16
      std::array<std::array<uint16_t, 256>, 3> colors = {};
      for (size_t c = 0; c < text.classes.size(); ++c) {
        for (int k = 0; k < 3; ++k) colors[k][c] = kScale * text.classes[c].color_rgb[k];
      }
      TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_PALETTE);
      TIFFSetField(tiff, TIFFTAG_COLORMAP, colors[0].data(), colors[1].data(), colors[2].data());
      TIFFSetField(tiff, kGdalNoDataTag, absl::StrCat(kNoClass).c_str());
      break;
    }
    case RasterContent::kColors: {
      const uint16_t alpha = EXTRASAMPLE_UNASSALPHA;
      TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_RGB);
      TIFFSetField(tiff, TIFFTAG_EXTRASAMPLES, 1, &alpha);
      break;
    }
  }
}

// Pixels of tiles beyond the image repeat those of an image without data.
bool WriteRasterTiles(TIFF* tiff, const RasterPixels& pixels) {
  const bool floats = pixels.content == RasterContent::kHeights;
  const size_t pixel_bytes = floats ? sizeof(float) : pixels.samples();
  const auto* const from = floats ? reinterpret_cast<const uint8_t*>(pixels.heights.data()) : pixels.bytes.data();
  const RasterPixels empty = EmptyRaster(pixels.content, kRasterTile, kRasterTile);
  const auto* const blank = floats ? reinterpret_cast<const uint8_t*>(empty.heights.data()) : empty.bytes.data();
  std::vector<uint8_t> tile(pixel_bytes * kRasterTile * kRasterTile);
  for (int y0 = 0; y0 < pixels.height; y0 += kRasterTile) {
    for (int x0 = 0; x0 < pixels.width; x0 += kRasterTile) {
      std::memcpy(tile.data(), blank, tile.size());
      const size_t row_bytes = pixel_bytes * std::min(kRasterTile, pixels.width - x0);
      for (int y = y0; y < std::min(y0 + kRasterTile, pixels.height); ++y) {
        std::memcpy(tile.data() + pixel_bytes * kRasterTile * (y - y0),
                    from + pixel_bytes * (static_cast<size_t>(y) * pixels.width + x0), row_bytes);
      }
      if (TIFFWriteTile(tiff, tile.data(), x0, y0, 0, 0) < 0) return false;
    }
  }
  return true;
}

}  // namespace

std::string RasterUnitName(double unit_m) {
  switch (RasterUnitCode(unit_m)) {
    case 9001:
      return "m";
    case 9002:
      return "ft";
    case 9003:
      return "US survey foot";
    default:
      return absl::StrFormat("%.10g m", unit_m);
  }
}

StatusOr<std::string> EncodeGeoTiff(const RasterPixels& pixels, const GeoTiffPlace& place, const GeoTiffText& text) {
  if (pixels.width <= 0 || pixels.height <= 0)
    return absl::InvalidArgumentError("cannot write a GeoTIFF without pixels");
  GeoTiffMemory memory;
  const auto failed = [&] { return absl::InternalError(absl::StrCat("libtiff: ", memory.error)); };
  {
    const GeoTiffFile tiff = memory.Open();
    if (tiff == nullptr) return failed();
    RasterPixels level = pixels;
    for (int factor = 1;; factor *= 2) {
      TIFFMergeFieldInfo(tiff.get(), kRasterTags.data(), kRasterTags.size());
      SetPixelTags(tiff.get(), level, text);
      if (factor == 1) {
        TESSERA_RETURN_IF_ERROR(SetPlaceTags(tiff.get(), pixels.content, place));
        TIFFSetField(tiff.get(), kGdalMetadataTag, RasterMetadata(pixels.content, place.system, text).c_str());
      } else {
        TIFFSetField(tiff.get(), TIFFTAG_SUBFILETYPE, FILETYPE_REDUCEDIMAGE);
      }
      if (!WriteRasterTiles(tiff.get(), level) || !TIFFWriteDirectory(tiff.get())) return failed();
      if (factor == kLastOverview || std::max(pixels.width, pixels.height) <= kRasterTile) break;
      level = HalfRaster(level);
    }
  }
  if (!memory.error.empty()) return failed();
  return std::move(memory.bytes);
}

}  // namespace tessera
