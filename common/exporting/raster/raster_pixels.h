// Pixels of the raster formats, and their overviews.
#pragma once

#include <cstdint>
#include <vector>

namespace tessera {

// kHeights: one float. kClasses: one byte, the class's index. kColors: red, green, blue, alpha (255: known, 0: not).
enum class RasterContent { kHeights, kClasses, kColors };

inline constexpr float kNoHeight = -9999;  // what QGIS and ArcGIS expect
inline constexpr uint8_t kNoClass = 255;
inline constexpr int kMaxRasterClasses = 255;  // indices below kNoClass

// Rows from the north, the bytes of a pixel side by side.
struct RasterPixels {
  RasterContent content = RasterContent::kHeights;
  int width = 0, height = 0;
  std::vector<float> heights;  // of kHeights
  std::vector<uint8_t> bytes;  // of kClasses and kColors

  int samples() const { return content == RasterContent::kColors ? 4 : 1; }
  bool HasData() const;  // not all pixels are without data
};

// Pixels without data.
RasterPixels EmptyRaster(RasterContent content, int width, int height);

// The overview with half the width and height, rounded up. Of up to four pixels with data: heights and colours have the
// mean, classes the most frequent value, of equally frequent ones the lowest.
RasterPixels HalfRaster(const RasterPixels& pixels);

}  // namespace tessera
