#include "common/synth/city/terrain_grid.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "common/base/random.h"

namespace tessera {
namespace {

constexpr double kSpacing = 1.0;  // largest distance of grid lines, metres

// Appends lines from the last one to `to` (included), about kSpacing apart.
void FillTo(std::vector<double>& lines, double to) {
  const double from = lines.back();
  const int steps = std::max(1, static_cast<int>(std::ceil((to - from) / kSpacing - 1e-9)));
  for (int k = 1; k <= steps; ++k) lines.push_back(from + (to - from) * k / steps);
}

void MakeLines(double low, int blocks, std::vector<double>& lines, std::vector<size_t>& start) {
  lines = {low - CityPlan::kApron};
  FillTo(lines, low - CityPlan::kKerbWidth);
  lines.push_back(low);
  for (int k = 0; k < blocks; ++k) {
    const double from = low + k * CityPlan::kPitch;
    start.push_back(k == 0 ? 0 : lines.size() - 1);
    FillTo(lines, from + CityPlan::kHalfStreet - CityPlan::kKerbWidth);
    lines.push_back(from + CityPlan::kHalfStreet);
    FillTo(lines, from + CityPlan::kPitch - CityPlan::kHalfStreet);
    lines.push_back(from + CityPlan::kPitch - CityPlan::kHalfStreet + CityPlan::kKerbWidth);
    FillTo(lines, from + CityPlan::kPitch);
  }
  lines.push_back(lines.back() + CityPlan::kKerbWidth);
  FillTo(lines, low + blocks * CityPlan::kPitch + CityPlan::kApron);
  start.push_back(lines.size() - 1);
}

const Planting* PlantingOfCell(const CityPlan& plan, const GroundGrid& grid, size_t i, size_t j) {
  return PlantingAt(plan, 0.5 * (grid.x_lines[i] + grid.x_lines[i + 1]), 0.5 * (grid.y_lines[j] + grid.y_lines[j + 1]));
}

}  // namespace

GroundGrid MakeGroundGrid(const CityPlan& plan) {
  GroundGrid grid;
  MakeLines(plan.MinX(), plan.columns, grid.x_lines, grid.column_start);
  MakeLines(plan.MinY(), plan.rows, grid.y_lines, grid.row_start);
  return grid;
}

Eigen::Vector3d GroundVertex(const CityPlan& plan, const GroundGrid& grid, size_t i, size_t j) {
  const double x = grid.x_lines[i], y = grid.y_lines[j];
  return {x, y, GroundHeight(plan, x, y)};
}

int32_t GroundCellLabel(const CityPlan& plan, const GroundGrid& grid, size_t i, size_t j) {
  return PlantingOfCell(plan, grid, i, j) == nullptr ? kGround : kVegetation;
}

TexturedSurface BuildGround(const CityPlan& plan, const GroundGrid& grid, int column, int row) {
  TexturedSurface ground;
  SurfacePatch patch;
  patch.seed = static_cast<uint32_t>(MixBits(plan.seed ^ 0x67726f756e64ull));
  patch.extent_m.x() = static_cast<float>(PlanBlock(plan, column, row).paved_share);
  ground.patches.push_back(patch);
  const size_t i0 = grid.column_start[column], i1 = grid.column_start[column + 1];
  const size_t j0 = grid.row_start[row], j1 = grid.row_start[row + 1];
  const size_t width = i1 - i0 + 1;
  for (size_t j = j0; j <= j1; ++j) {
    for (size_t i = i0; i <= i1; ++i) ground.mesh.vertices.push_back(GroundVertex(plan, grid, i, j));
  }
  std::map<const Planting*, uint32_t> patches = {{nullptr, 0}};
  for (size_t j = 0; j < j1 - j0; ++j) {
    for (size_t i = 0; i < i1 - i0; ++i) {
      const uint32_t a = static_cast<uint32_t>(j * width + i), b = a + 1, d = a + static_cast<uint32_t>(width),
                     c = d + 1;
      ground.mesh.faces.push_back({a, b, c});
      ground.mesh.faces.push_back({a, c, d});
      const Planting* planting = PlantingOfCell(plan, grid, i0 + i, j0 + j);
      const auto [place, fresh] = patches.try_emplace(planting, static_cast<uint32_t>(ground.patches.size()));
      if (fresh)
        ground.patches.push_back(
            PlantingPatch(planting->seed, {planting->area.min().x(), planting->area.min().y(), 0}));
      ground.mesh.labels.insert(ground.mesh.labels.end(), 2, planting == nullptr ? kGround : kVegetation);
      ground.patch_of_face.insert(ground.patch_of_face.end(), 2, place->second);
    }
  }
  return ground;
}

}  // namespace tessera
