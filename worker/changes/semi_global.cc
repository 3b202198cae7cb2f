#include "worker/changes/semi_global.h"

#include <algorithm>
#include <limits>

namespace tessera {
namespace {

constexpr int16_t kFar = std::numeric_limits<int16_t>::max() / 2;

// One step of a path (Hirschmüller 2008, eq. 13): the new path costs `to` from the previous cell's `from`. Both have
// a sentinel kFar at each end, which avoids branches. Returns the minimum of `to`.
int16_t Step(const uint8_t* cost, const int16_t* from, int16_t from_least, int levels, int16_t one_level, int16_t more,
             int16_t* to) {
  const int16_t jump = static_cast<int16_t>(from_least + more);
  int16_t least = kFar;
  for (int d = 1; d <= levels; ++d) {
    const int16_t beside = static_cast<int16_t>(std::min(from[d - 1], from[d + 1]) + one_level);
    const int16_t best = std::min(std::min(from[d], beside), jump);
    to[d] = static_cast<int16_t>(best - from_least + cost[d - 1]);
    least = std::min(least, to[d]);
  }
  return least;
}

// Path costs of the cells of a row, by column.
struct PathRow {
  std::vector<int16_t> value, least;
  PathRow(int width, int levels) : value(static_cast<size_t>(width) * (levels + 2), kFar), least(width, 0) {}
};

}  // namespace

std::vector<int16_t> AggregateCosts(const CostVolume& volume, const std::vector<uint8_t>& edge,
                                    const SmoothPenalties& penalties) {
  const int width = volume.width, height = volume.height, levels = volume.levels, stride = levels + 2;
  std::vector<int16_t> sum(volume.cost.size(), 0);
  const auto flagged = [&](int x, int y) { return !edge.empty() && edge[static_cast<size_t>(y) * width + x] != 0; };
  const int16_t one_level = static_cast<int16_t>(penalties.one_level);
  PathRow last(width, levels), next(width, levels);
  for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {-1, 1}, {1, -1}, {-1, -1}}) {
    for (int row = 0; row < height; ++row) {
      const int y = dy >= 0 ? row : height - 1 - row;
      for (int column = 0; column < width; ++column) {
        const int x = dx >= 0 ? column : width - 1 - column;
        const uint8_t* cost = volume.At(x, y);
        int16_t* to = &next.value[static_cast<size_t>(x) * stride];
        const int before_x = x - dx, before_y = y - dy;
        if (before_x < 0 || before_x >= width || before_y < 0 || before_y >= height) {
          std::copy(cost, cost + levels, to + 1);
          next.least[x] = *std::min_element(cost, cost + levels);
        } else {
          const PathRow& from = dy == 0 ? next : last;
          const int more = flagged(x, y) || flagged(before_x, before_y) ? penalties.at_edge : penalties.more;
          next.least[x] = Step(cost, &from.value[static_cast<size_t>(before_x) * stride], from.least[before_x], levels,
                               one_level, static_cast<int16_t>(more), to);
        }
        int16_t* total = &sum[(static_cast<size_t>(y) * width + x) * levels];
        for (int d = 0; d < levels; ++d) total[d] = static_cast<int16_t>(total[d] + to[d + 1]);
      }
      if (dy != 0) std::swap(last, next);
    }
  }
  return sum;
}

}  // namespace tessera
