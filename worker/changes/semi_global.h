// Semi-global aggregation: Hirschmüller, Stereo processing by semiglobal matching and mutual information, PAMI 2008,
// section 2.3, with the cells of a raster as pixels and heights as disparities.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace tessera {

// Costs of `levels` heights in each of width x height cells, at most 200 each. Levels are contiguous within a cell;
// cells are row-major.
struct CostVolume {
  int width = 0, height = 0, levels = 0;
  std::vector<uint8_t> cost;

  CostVolume() = default;
  CostVolume(int w, int h, int d, uint8_t value) : width(w), height(h), levels(d), cost(Size(w, h, d), value) {}
  static size_t Size(int w, int h, int d) { return static_cast<size_t>(w) * h * d; }
  uint8_t* At(int x, int y) { return cost.data() + (static_cast<size_t>(y) * width + x) * levels; }
  const uint8_t* At(int x, int y) const { return cost.data() + (static_cast<size_t>(y) * width + x) * levels; }
};

// Penalties for a height step between neighbours: by one level, by more, and by more at an edge. At most 300.
struct SmoothPenalties {
  int one_level = 8, more = 40, at_edge = 30;
};

// Sum of the path costs from eight directions, same layout as the costs. `edge`: one flag per cell; steps of more
// than one level between two cells cost `at_edge` if either has the flag. Empty: no edges.
std::vector<int16_t> AggregateCosts(const CostVolume& volume, const std::vector<uint8_t>& edge,
                                    const SmoothPenalties& penalties);

}  // namespace tessera
