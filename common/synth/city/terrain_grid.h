// The ground as a height field on a tensor grid with lines along the kerbs.
#pragma once

#include <cstdint>
#include <vector>

#include "common/synth/city/plan.h"
#include "common/synth/city/surface.h"

namespace tessera {

// Grid lines of the whole city's ground, and the first line of each block. Outermost blocks include the apron.
struct GroundGrid {
  std::vector<double> x_lines, y_lines;
  std::vector<size_t> column_start, row_start;  // first line of each block column/row; one more: the last line

  size_t Vertex(size_t i, size_t j) const { return j * x_lines.size() + i; }
};

GroundGrid MakeGroundGrid(const CityPlan& plan);

Eigen::Vector3d GroundVertex(const CityPlan& plan, const GroundGrid& grid, size_t i, size_t j);

// Class of the grid cell between lines i, i + 1 and j, j + 1.
int32_t GroundCellLabel(const CityPlan& plan, const GroundGrid& grid, size_t i, size_t j);

// The ground of one block; vertices are not shared with other blocks.
TexturedSurface BuildGround(const CityPlan& plan, const GroundGrid& grid, int column, int row);

}  // namespace tessera
