#include "worker/visibility/far_silhouettes.h"

#include <algorithm>

namespace tessera {

FarSilhouettes::FarSilhouettes(const FaceMap& map, const PosedCamera& camera, const Eigen::Vector3d& up, double reach_m)
    : width_(map.width), height_(map.height), passes_(static_cast<size_t>(map.width) * map.height) {
  // Of a row, where on the ground each pixel looks.
  struct Row {
    std::vector<Eigen::Vector3d> at;
    std::vector<uint8_t> sees;
  };
  const Eigen::Vector3d centre = camera.Centre();
  const auto look = [&](int y, Row* row) {
    row->at.resize(width_);
    row->sees.resize(width_);
    for (int x = 0; x < width_; ++x) {
      const float depth = map.depth[static_cast<size_t>(y) * width_ + x];
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
  Row above, row;
  for (int y = 0; y < height_; ++y) {
    std::swap(above, row);
    look(y, &row);
    const size_t begin = static_cast<size_t>(y) * width_;
    for (int x = 0; x < width_; ++x) {
      if (x > 0 && parted(row, x - 1, row, x)) passes_[begin + x - 1] = passes_[begin + x] = true;
      if (y > 0 && parted(above, x, row, x)) passes_[begin + x - width_] = passes_[begin + x] = true;
    }
  }
}

std::vector<PixelRun> FarSilhouettes::Near(int level, int radius_px) const {
  const int width = width_ >> level, height = height_ >> level;
  // Along the rows first, then down the columns: the last row at which a line passed near each column.
  std::vector<uint8_t> near_in_row(static_cast<size_t>(width) * height);
  for (int y = 0; y < height << level; ++y) {
    uint8_t* row = &near_in_row[static_cast<size_t>(y >> level) * width];
    for (int x = 0; x < width << level; ++x) {
      if (!passes_[static_cast<size_t>(y) * width_ + x]) continue;
      const int at = x >> level;
      std::fill(row + std::max(0, at - radius_px), row + std::min(width, at + radius_px + 1), uint8_t{1});
    }
  }
  std::vector<PixelRun> runs;
  std::vector<int> rows_near(width, 0);  // of each column, rows with a line in the band about the row at hand
  const auto count_row = [&](int y, int sign) {
    if (y < 0 || y >= height) return;
    const uint8_t* row = &near_in_row[static_cast<size_t>(y) * width];
    for (int x = 0; x < width; ++x) rows_near[x] += sign * row[x];
  };
  for (int y = 0; y < radius_px; ++y) count_row(y, 1);
  for (int y = 0; y < height; ++y) {
    count_row(y + radius_px, 1);
    count_row(y - radius_px - 1, -1);
    const uint32_t begin = static_cast<uint32_t>(y) * static_cast<uint32_t>(width);
    for (int x = 0; x < width; ++x) {
      if (rows_near[x] == 0) continue;
      const uint32_t i = begin + static_cast<uint32_t>(x);
      if (!runs.empty() && runs.back().last == i) {
        runs.back().last = i + 1;
      } else {
        runs.push_back({i, i + 1});
      }
    }
  }
  return runs;
}

}  // namespace tessera
