#include "worker/changes/change_raster.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/arrays/array_file.h"

namespace tessera {
namespace {

using nlohmann::json;

// Calls copy(i, j, count) for the cells of each row of the common part of three rectangles, by their first cell's index
// in `from` and in `to`.
template <class Copy>
void ForCommonRows(const CellRect& from, const CellRect& part, const CellRect& to, const Copy& copy) {
  const int x0 = std::max({from.x0, part.x0, to.x0}), x1 = std::min({from.x1, part.x1, to.x1});
  if (x0 >= x1) return;
  const auto index = [x0](const CellRect& cells, int y) {
    return static_cast<ptrdiff_t>(y - cells.y0) * (cells.x1 - cells.x0) + (x0 - cells.x0);
  };
  for (int y = std::max({from.y0, part.y0, to.y0}); y < std::min({from.y1, part.y1, to.y1}); ++y) {
    copy(index(from, y), index(to, y), x1 - x0);
  }
}

}  // namespace

SurfaceRaster::SurfaceRaster(const CellRect& rect, double cell_size_m) : cells(rect), cell_m(cell_size_m) {
  height_m.assign(size(), kNotKnown);
  label.assign(size(), kNoLabel);
}

ChangeRaster::ChangeRaster(const CellRect& rect, double cell_size_m)
    : before(rect, cell_size_m), after(rect, cell_size_m) {
  after_score.assign(before.size(), kNotKnown);
  before_score.assign(before.size(), kNotKnown);
  label_margin.assign(before.size(), 0.0f);
}

void CopyCells(const SurfaceRaster& from, const CellRect& part, SurfaceRaster* to) {
  ForCommonRows(from.cells, part, to->cells, [&](ptrdiff_t i, ptrdiff_t j, int count) {
    std::copy_n(from.height_m.begin() + i, count, to->height_m.begin() + j);
    std::copy_n(from.label.begin() + i, count, to->label.begin() + j);
  });
}

void CopyCells(const ChangeRaster& from, const CellRect& part, ChangeRaster* to) {
  CopyCells(from.before, part, &to->before);
  CopyCells(from.after, part, &to->after);
  ForCommonRows(from.cells(), part, to->cells(), [&](ptrdiff_t i, ptrdiff_t j, int count) {
    std::copy_n(from.before_score.begin() + i, count, to->before_score.begin() + j);
    std::copy_n(from.after_score.begin() + i, count, to->after_score.begin() + j);
    std::copy_n(from.label_margin.begin() + i, count, to->label_margin.begin() + j);
  });
}

Status WriteChangeRaster(const std::string& path, const ChangeRaster& raster) {
  const CellRect& cells = raster.cells();
  ArrayFile file;
  file.metadata = json{{"cells", {cells.x0, cells.y0, cells.x1, cells.y1}}, {"cell_m", raster.cell_m()}}.dump();
  file.arrays = {{"height_before", raster.before.height_m}, {"label_before", raster.before.label},
                 {"height_after", raster.after.height_m},   {"label_after", raster.after.label},
                 {"score_before", raster.before_score},     {"score_after", raster.after_score},
                 {"label_margin", raster.label_margin}};
  return WriteArrayFile(path, file);
}

StatusOr<ChangeRaster> ReadChangeRaster(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(ArrayFile file, ReadArrayFile(path));
  ChangeRaster raster;
  try {
    const json metadata = json::parse(file.metadata);
    const json& c = metadata.at("cells");
    raster = ChangeRaster({c.at(0), c.at(1), c.at(2), c.at(3)}, metadata.at("cell_m"));
  } catch (const json::exception& e) {
    return absl::DataLossError(path + ": found invalid metadata, expected that of a change raster: " + e.what());
  }
  const auto cells = static_cast<int64_t>(raster.before.size());
  TESSERA_ASSIGN_OR_RETURN(raster.before.height_m, file.Take<float>("height_before", cells));
  TESSERA_ASSIGN_OR_RETURN(raster.before.label, file.Take<uint8_t>("label_before", cells));
  TESSERA_ASSIGN_OR_RETURN(raster.after.height_m, file.Take<float>("height_after", cells));
  TESSERA_ASSIGN_OR_RETURN(raster.after.label, file.Take<uint8_t>("label_after", cells));
  TESSERA_ASSIGN_OR_RETURN(raster.before_score, file.Take<float>("score_before", cells));
  TESSERA_ASSIGN_OR_RETURN(raster.after_score, file.Take<float>("score_after", cells));
  TESSERA_ASSIGN_OR_RETURN(raster.label_margin, file.Take<float>("label_margin", cells));
  return raster;
}

}  // namespace tessera
