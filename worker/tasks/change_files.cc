#include "worker/tasks/change_files.h"

#include <nlohmann/json.hpp>

#include "common/arrays/array_file.h"

namespace tessera {

using nlohmann::json;

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
