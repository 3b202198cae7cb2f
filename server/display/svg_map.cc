#include "server/display/svg_map.h"

#include <Eigen/Geometry>
#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera {

std::string ToSvg(const SvgMap& map) {
  Eigen::AlignedBox2d box;
  for (const SvgMap::Tile& tile : map.tiles) {
    box.extend(Eigen::Vector2d(tile.x0, tile.y0));
    box.extend(Eigen::Vector2d(tile.x1, tile.y1));
  }
  for (const SvgMap::Camera& camera : map.cameras) box.extend(Eigen::Vector2d(camera.x, camera.y));
  const double x0 = box.min().x(), y0 = box.min().y(), x1 = box.max().x(), y1 = box.max().y();
  const double size = std::max({x1 - x0, y1 - y0, 1e-9}), margin = 0.03 * size, line = size / 600, letter = size / 45;
  // SVG's y axis points down.
  std::string out = absl::StrFormat(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"900\" viewBox=\"%.3f %.3f %.3f %.3f\" "
      "font-family=\"sans-serif\" font-size=\"%.3f\">\n",
      x0 - margin, -y1 - margin, x1 - x0 + 2 * margin, y1 - y0 + 2 * margin + 3 * letter, letter);
  for (const SvgMap::Tile& tile : map.tiles) {
    absl::StrAppendFormat(&out,
                          "<rect x=\"%.3f\" y=\"%.3f\" width=\"%.3f\" height=\"%.3f\" fill=\"%s\" stroke=\"#333\" "
                          "stroke-width=\"%.3f\"><title>%s</title></rect>\n",
                          tile.x0, -tile.y1, tile.x1 - tile.x0, tile.y1 - tile.y0, tile.fill, line, tile.tooltip);
  }
  for (const SvgMap::Camera& camera : map.cameras) {
    absl::StrAppendFormat(&out, "<circle cx=\"%.3f\" cy=\"%.3f\" r=\"%.3f\" stroke-width=\"%.3f\" %s/>\n", camera.x,
                          -camera.y, 2.5 * line, 0.7 * line, camera.style);
  }
  absl::StrAppendFormat(&out, "<text x=\"%.3f\" y=\"%.3f\">%s</text>\n</svg>\n", x0, -y0 + margin + 1.5 * letter,
                        map.caption);
  return out;
}

}  // namespace tessera
