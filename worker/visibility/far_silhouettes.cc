#include "worker/visibility/far_silhouettes.h"

#include <algorithm>

namespace tessera {

FarSilhouettes FindFarSilhouettes(const FaceMap& map, const PosedCamera& camera, const Eigen::Vector3d& up,
                                  double reach_m) {
  FarSilhouettes found;
  // Of a row, where on the ground each pixel looks.
  struct Row {
    std::vector<Eigen::Vector3d> at;
    std::vector<uint8_t> sees;
  };
  const Eigen::Vector3d centre = camera.Centre();
  const auto look = [&](int y, Row* row) {
    row->at.resize(map.width);
    row->sees.resize(map.width);
    for (int x = 0; x < map.width; ++x) {
      const float depth = map.depth[static_cast<size_t>(y) * map.width + x];
      row->sees[x] = depth < FaceMap::kNothing;
      if (!row->sees[x]) continue;
      const Eigen::Vector3d p = centre + static_cast<double>(depth) * camera.Ray(map.x0 + x + 0.5, map.y0 + y + 0.5);
      row->at[x] = p - up * up.dot(p);
    }
  };
  const auto parted = [&](const Row& a, int i, const Row& b, int j) {
    if (a.sees[i] != b.sees[j]) return true;
    return a.sees[i] && (a.at[i] - b.at[j]).squaredNorm() > reach_m * reach_m;
  };
  // What is behind lies about as much deeper as it lies farther off; the front does not move that far.
  const float room_m = static_cast<float>(reach_m / 3);
  std::vector<float> depth_above(map.width, FaceMap::kNothing), depth_here(map.width, FaceMap::kNothing);
  Row above, row;
  const auto flush = [&](int y) {  // the row before is done
    for (int x = 0; x < map.width; ++x) {
      if (depth_above[x] < FaceMap::kNothing) found.passing.push_back({map.x0 + x, map.y0 + y, depth_above[x]});
    }
  };
  for (int y = 0; y < map.height; ++y) {
    std::swap(above, row);
    look(y, &row);
    const float* depth = map.depth.data() + static_cast<size_t>(y) * map.width;
    for (int x = 0; x < map.width; ++x) {
      if (x > 0 && parted(row, x - 1, row, x)) {
        const float limit = std::min(depth[x - 1], depth[x]) + room_m;
        depth_here[x - 1] = std::min(depth_here[x - 1], limit);
        depth_here[x] = std::min(depth_here[x], limit);
      }
      if (y > 0 && parted(above, x, row, x)) {
        const float limit = std::min(depth[x - map.width], depth[x]) + room_m;
        depth_above[x] = std::min(depth_above[x], limit);
        depth_here[x] = std::min(depth_here[x], limit);
      }
    }
    flush(y - 1);
    std::swap(depth_above, depth_here);
    std::fill(depth_here.begin(), depth_here.end(), FaceMap::kNothing);
  }
  flush(map.height - 1);
  return found;
}

std::vector<BlindPixel> FarSilhouettes::Near(int level, const PixelRect& rect, int radius_px) const {
  // Along the rows first, then down the columns: the least depth of the lines that pass near.
  const int width = rect.width(), height = rect.height();
  const int rows = height + 2 * radius_px;  // those above and below, too
  std::vector<float> in_row(static_cast<size_t>(width) * rows, FaceMap::kNothing);
  for (const Passing& line : passing) {
    const int x = (line.x >> level) - rect.x0, y = (line.y >> level) - rect.y0 + radius_px;
    if (y < 0 || y >= rows) continue;
    float* row = &in_row[static_cast<size_t>(y) * width];
    for (int i = std::max(0, x - radius_px); i < std::min(width, x + radius_px + 1); ++i) {
      row[i] = std::min(row[i], line.depth);
    }
  }
  std::vector<BlindPixel> near;
  std::vector<float> least(width);
  for (int y = 0; y < height; ++y) {
    std::fill(least.begin(), least.end(), FaceMap::kNothing);
    for (int j = y; j <= y + 2 * radius_px; ++j) {
      const float* row = &in_row[static_cast<size_t>(j) * width];
      for (int x = 0; x < width; ++x) least[x] = std::min(least[x], row[x]);
    }
    for (int x = 0; x < width; ++x) {
      if (least[x] < FaceMap::kNothing) near.push_back({static_cast<uint32_t>(y * width + x), least[x]});
    }
  }
  return near;
}

}  // namespace tessera
