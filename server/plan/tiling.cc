#include "server/plan/tiling.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace tessera {
namespace {

double WorkOf(const SurveyCell& cell) {
  return static_cast<double>(cell.faces) * static_cast<double>(1 + cell.views.size());
}

double DistanceToCell(const SurveyCell& cell, const CellRect& rect, double cell_m) {
  return DistanceBetween({cell.x, cell.y, cell.x + 1, cell.y + 1}, rect, cell_m);
}

// Cuts [begin, begin + work.size()) into `shares.size()` parts, part i with about shares[i] of the work, every part at
// least one cell wide. Gives the borders, one more than parts. There are at least as many cells as parts.
std::vector<int> CutByWork(int begin, const std::vector<double>& work, const std::vector<double>& shares) {
  double total_work = 0, total_share = 0;
  for (const double w : work) total_work += w;
  for (const double s : shares) total_share += s;
  const int cells = static_cast<int>(work.size()), parts = static_cast<int>(shares.size());
  std::vector<int> borders = {begin};
  double done = 0, wanted = 0;
  int at = 0;
  for (int part = 0; part + 1 < parts; ++part) {
    wanted += shares[part] / total_share * total_work;
    const int first = at + 1, last = cells - (parts - part - 1);
    // The border whose sum is nearest to what is wanted.
    do {
      done += work[at++];
    } while (at < last && (at < first || std::abs(done + work[at] - wanted) <= std::abs(done - wanted)));
    borders.push_back(begin + at);
  }
  borders.push_back(begin + cells);
  return borders;
}

}  // namespace

double PredictWork(const Survey& survey, const CellRect& core, double halo_m) {
  double work = 0;
  for (const SurveyCell& cell : survey.cells) {
    if (DistanceToCell(cell, core, survey.ground.cell_m) <= halo_m) work += WorkOf(cell);
  }
  return work;
}

std::vector<CellRect> LayOutTiles(const Survey& survey, const TilingOptions& options) {
  CellRect all = {INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN};
  double faces = 0, work = 0;
  for (const SurveyCell& cell : survey.cells) {
    all = {std::min(all.x0, cell.x), std::min(all.y0, cell.y), std::max(all.x1, cell.x + 1),
           std::max(all.y1, cell.y + 1)};
    faces += static_cast<double>(cell.faces);
    work += WorkOf(cell);
  }
  const int width = all.x1 - all.x0, height = all.y1 - all.y0;
  const double wanted =
      options.tiles > 0 ? options.tiles : std::ceil(std::max(faces / options.max_faces, work / options.max_work));
  const int tiles = static_cast<int>(std::clamp(wanted, 1.0, static_cast<double>(width) * height));
  const int rows = std::clamp(static_cast<int>(std::lround(std::sqrt(static_cast<double>(tiles) * height / width))),
                              (tiles + width - 1) / width, std::min(tiles, height));

  std::vector<double> row_tiles(rows), row_work(height, 0.0);
  for (int r = 0; r < rows; ++r) {
    row_tiles[r] =
        static_cast<double>(static_cast<int64_t>(tiles) * (r + 1) / rows - static_cast<int64_t>(tiles) * r / rows);
  }
  for (const SurveyCell& cell : survey.cells) row_work[cell.y - all.y0] += WorkOf(cell);
  const std::vector<int> row_borders = CutByWork(all.y0, row_work, row_tiles);

  std::vector<CellRect> rects;
  for (int r = 0; r < rows; ++r) {
    std::vector<double> column_work(width, 0.0);
    for (const SurveyCell& cell : survey.cells) {
      if (cell.y >= row_borders[r] && cell.y < row_borders[r + 1]) column_work[cell.x - all.x0] += WorkOf(cell);
    }
    const std::vector<double> even(static_cast<size_t>(row_tiles[r]), 1.0);
    const std::vector<int> borders = CutByWork(all.x0, column_work, even);
    for (size_t c = 0; c + 1 < borders.size(); ++c) {
      const CellRect rect = {borders[c], row_borders[r], borders[c + 1], row_borders[r + 1]};
      const bool used = std::any_of(survey.cells.begin(), survey.cells.end(), [&](const SurveyCell& cell) {
        return rect.Contains({cell.x, cell.y});
      });
      if (used) rects.push_back(rect);
    }
  }
  return rects;
}

}  // namespace tessera
