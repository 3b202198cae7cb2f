#include "common/exporting/raster/raster_vrt.h"

#include <algorithm>
#include <array>
#include <limits>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/storage/xml_file.h"

namespace tessera {
namespace {

RasterBox RasterUnion(const std::vector<VrtSource>& sources) {
  constexpr int64_t kLargest = std::numeric_limits<int64_t>::max();
  int64_t x0 = kLargest, y0 = kLargest, x1 = -kLargest, y1 = -kLargest;
  for (const VrtSource& source : sources) {
    x0 = std::min(x0, source.box.x0);
    y0 = std::min(y0, source.box.y0);
    x1 = std::max(x1, source.box.x0 + source.box.width);
    y1 = std::max(y1, source.box.y0 + source.box.height);
  }
  return {x0, y0, static_cast<int>(x1 - x0), static_cast<int>(y1 - y0)};
}

// `band`: from 1; `no_data`: empty if the source's alpha channel says which pixels have data.
std::string VrtSourceXml(const VrtSource& source, const RasterBox& all, int band, const std::string& type,
                         const std::string& no_data) {
  const std::string size = absl::StrFormat("xSize=\"%d\" ySize=\"%d\"", source.box.width, source.box.height);
  return absl::StrCat(
      "    <ComplexSource>\n      <SourceFilename relativeToVRT=\"1\">", EscapeMarkup(source.file),
      "</SourceFilename>\n      <SourceBand>", band, "</SourceBand>\n",
      absl::StrFormat(
          "      <SourceProperties RasterXSize=\"%d\" RasterYSize=\"%d\" DataType=\"%s\" BlockXSize=\"256\" "
          "BlockYSize=\"256\"/>\n",
          source.box.width, source.box.height, type),
      "      <SrcRect xOff=\"0\" yOff=\"0\" ", size, "/>\n",
      absl::StrFormat("      <DstRect xOff=\"%d\" yOff=\"%d\" %s/>\n", source.box.x0 - all.x0,
                      all.y0 + all.height - source.box.y0 - source.box.height, size),
      no_data.empty() ? std::string("      <UseMaskBand>true</UseMaskBand>\n")
                      : absl::StrCat("      <NODATA>", no_data, "</NODATA>\n"),
      "    </ComplexSource>\n");
}

std::string RasterClassesXml(const std::vector<SceneClass>& classes) {
  std::string names = "    <CategoryNames>\n", colors = "    <ColorTable>\n";
  for (const SceneClass& c : classes) {
    absl::StrAppend(&names, "      <Category>", EscapeMarkup(c.name), "</Category>\n");
    absl::StrAppend(&colors, absl::StrFormat("      <Entry c1=\"%d\" c2=\"%d\" c3=\"%d\" c4=\"255\"/>\n",
                                             c.color_rgb[0], c.color_rgb[1], c.color_rgb[2]));
  }
  return absl::StrCat(names, "    </CategoryNames>\n", colors, "    </ColorTable>\n");
}

}  // namespace

std::string MosaicVrt(RasterContent content, const RasterMap& map, const std::vector<SceneClass>& classes,
                      const std::vector<VrtSource>& sources) {
  const RasterBox all = RasterUnion(sources);
  const RasterSystem& system = map.system();
  const Eigen::Vector2d corner = all.Corner(map.pixel_size());
  std::string xml = absl::StrFormat("<VRTDataset rasterXSize=\"%d\" rasterYSize=\"%d\">\n", all.width, all.height);
  if (!system.wkt.empty()) absl::StrAppend(&xml, "  <SRS>", EscapeMarkup(system.wkt), "</SRS>\n");
  absl::StrAppend(&xml,
                  absl::StrFormat("  <GeoTransform>%.17g, %.17g, 0, %.17g, 0, %.17g</GeoTransform>\n", corner.x(),
                                  map.pixel_size().x(), corner.y(), -map.pixel_size().y()),
                  "  <Metadata>\n    <MDI key=\"AREA_OR_POINT\">Area</MDI>\n  </Metadata>\n");
  constexpr std::array kColorBands = {"Red", "Green", "Blue", "Alpha"};
  const int bands = content == RasterContent::kColors ? 4 : 1;
  const std::string type = content == RasterContent::kHeights ? "Float32" : "Byte";
  for (int band = 1; band <= bands; ++band) {
    absl::StrAppend(&xml, "  <VRTRasterBand dataType=\"", type, "\" band=\"", band, "\">\n");
    std::string no_data;
    if (content == RasterContent::kHeights) {
      no_data = absl::StrCat(kNoHeight);
      absl::StrAppend(&xml, "    <Description>height of the surface</Description>\n    <UnitType>",
                      EscapeMarkup(RasterUnitName(system.height_unit_m)), "</UnitType>\n");
    } else if (content == RasterContent::kClasses) {
      no_data = absl::StrCat(kNoClass);
      absl::StrAppend(&xml, "    <Description>class</Description>\n", RasterClassesXml(classes),
                      "    <ColorInterp>Palette</ColorInterp>\n");
    } else {
      absl::StrAppend(&xml, "    <ColorInterp>", kColorBands[band - 1], "</ColorInterp>\n");
    }
    if (!no_data.empty()) absl::StrAppend(&xml, "    <NoDataValue>", no_data, "</NoDataValue>\n");
    // The alpha channel has no mask of its own: its zeros are skipped.
    const std::string skipped = content == RasterContent::kColors && band == 4 ? "0" : no_data;
    for (const VrtSource& source : sources) absl::StrAppend(&xml, VrtSourceXml(source, all, band, type, skipped));
    absl::StrAppend(&xml, "  </VRTRasterBand>\n");
  }
  return absl::StrCat(xml, "</VRTDataset>\n");
}

}  // namespace tessera
