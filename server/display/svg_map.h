// A map of tiles and cameras as SVG.
#pragma once

#include <string>
#include <vector>

namespace tessera {

// Coordinates are metres on the ground plane, y up.
struct SvgMap {
  struct Tile {
    double x0 = 0, y0 = 0, x1 = 0, y1 = 0;
    std::string fill;     // an SVG colour
    std::string tooltip;  // plain text
  };
  struct Camera {
    double x = 0, y = 0;
    std::string style;  // SVG attributes
  };
  std::vector<Tile> tiles;
  std::vector<Camera> cameras;
  std::string caption;
};

// The whole file. One unit is one metre.
std::string ToSvg(const SvgMap& map);

}  // namespace tessera
