#include "worker/changes/cell_mask.h"

#include <algorithm>

namespace tessera {
namespace {

// Cells with at least `least` set cells in the window [-before, after] along rows and columns.
CellMask CountAtLeast(const CellMask& mask, int before, int after, int least) {
  const int width = mask.width, height = mask.height;
  std::vector<int> rows(mask.flag.size(), 0);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      int sum = 0;
      for (int k = std::max(x - before, 0); k <= std::min(x + after, width - 1); ++k) {
        sum += mask.flag[static_cast<size_t>(y) * width + k] ? 1 : 0;
      }
      rows[static_cast<size_t>(y) * width + x] = sum;
    }
  }
  CellMask counted(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      int sum = 0;
      for (int k = std::max(y - before, 0); k <= std::min(y + after, height - 1); ++k) {
        sum += rows[static_cast<size_t>(k) * width + x];
      }
      counted.flag[static_cast<size_t>(y) * width + x] = sum >= least;
    }
  }
  return counted;
}

}  // namespace

CellMask Majority(const CellMask& mask) { return CountAtLeast(mask, 1, 1, 5); }

CellMask WithoutSlivers(const CellMask& mask, int side) {
  const CellMask squares = CountAtLeast(mask, 0, side - 1, side * side);  // indexed by the square's first cell
  const CellMask opened = CountAtLeast(squares, side - 1, 0, 1);
  CellMask kept = CountAtLeast(opened, 1, 1, 1);
  for (size_t i = 0; i < kept.flag.size(); ++i) kept.flag[i] = kept.flag[i] && mask.flag[i];
  return kept;
}

std::vector<std::vector<size_t>> ConnectedParts(const CellMask& mask, const CellMask& seeds) {
  std::vector<std::vector<size_t>> parts;
  std::vector<uint8_t> done(mask.flag.size(), 0);
  for (size_t first = 0; first < mask.flag.size(); ++first) {
    if (!mask.flag[first] || done[first]) continue;
    std::vector<size_t> part = {first};
    done[first] = 1;
    bool seeded = false;
    for (size_t next = 0; next < part.size(); ++next) {
      const size_t i = part[next], x = i % mask.width;
      seeded = seeded || seeds.flag[i];
      const auto add = [&](size_t j) {
        if (!mask.flag[j] || done[j]) return;
        done[j] = 1;
        part.push_back(j);
      };
      if (x > 0) add(i - 1);
      if (x + 1 < static_cast<size_t>(mask.width)) add(i + 1);
      if (i >= static_cast<size_t>(mask.width)) add(i - mask.width);
      if (i + mask.width < mask.flag.size()) add(i + mask.width);
    }
    if (!seeded) continue;
    std::sort(part.begin(), part.end());
    parts.push_back(std::move(part));
  }
  return parts;
}

}  // namespace tessera
