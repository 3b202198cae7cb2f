#include "common/exporting/sheet.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/arrays/array_file.h"

namespace tessera {
namespace {

int SheetCoordinate(int cell) { return cell >= 0 ? cell / kSheetCells : -((-cell + kSheetCells - 1) / kSheetCells); }

// Values of 3-vectors and arrays of three, one after the other.
template <class T, class Three>
std::vector<T> Flat(const std::vector<Three>& values) {
  std::vector<T> flat;
  flat.reserve(3 * values.size());
  for (const Three& value : values) flat.insert(flat.end(), {value[0], value[1], value[2]});
  return flat;
}

template <class Three, class T>
std::vector<Three> InThrees(const std::vector<T>& flat) {
  std::vector<Three> values(flat.size() / 3);
  for (size_t i = 0; i < values.size(); ++i) {
    for (int k = 0; k < 3; ++k) values[i][k] = flat[3 * i + k];
  }
  return values;
}

}  // namespace

SheetId SheetOf(const Eigen::Vector2i& cell) { return {SheetCoordinate(cell.x()), SheetCoordinate(cell.y())}; }

CellRect CellsOf(const SheetId& id) {
  return {id.x * kSheetCells, id.y * kSheetCells, (id.x + 1) * kSheetCells, (id.y + 1) * kSheetCells};
}

std::string SheetName(const SheetId& id) { return absl::StrCat(id.x, "_", id.y); }

Status WriteSheet(const std::string& path, const Sheet& sheet) {
  ArrayFile file;
  file.arrays["vertices"] = Flat<double>(sheet.vertices);
  file.arrays["faces"] = Flat<uint32_t>(sheet.faces);
  file.arrays["labels"] = sheet.labels;
  file.arrays["confidence"] = sheet.confidence;
  file.arrays["displacement_m"] = sheet.displacement_m;
  file.arrays["colors"] = Flat<uint8_t>(sheet.colors);
  file.arrays["shared"] = sheet.shared;
  return WriteArrayFile(path, file);
}

StatusOr<Sheet> ReadSheet(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(ArrayFile file, ReadArrayFile(path));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<double> vertices, file.Take<double>("vertices"));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint32_t> faces, file.Take<uint32_t>("faces"));
  Sheet sheet;
  TESSERA_ASSIGN_OR_RETURN(sheet.labels, file.Take<int32_t>("labels"));
  TESSERA_ASSIGN_OR_RETURN(sheet.confidence, file.Take<float>("confidence"));
  TESSERA_ASSIGN_OR_RETURN(sheet.displacement_m, file.Take<float>("displacement_m"));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> colors, file.Take<uint8_t>("colors"));
  TESSERA_ASSIGN_OR_RETURN(sheet.shared, file.Take<uint8_t>("shared"));
  const size_t vertex_count = vertices.size() / 3, face_count = faces.size() / 3;
  const auto fits = [](size_t found, size_t expected) { return found == 0 || found == expected; };
  if (vertices.size() % 3 != 0 || faces.size() % 3 != 0 || sheet.labels.size() != face_count ||
      !fits(sheet.confidence.size(), face_count) || !fits(sheet.displacement_m.size(), vertex_count) ||
      !fits(colors.size(), 3 * vertex_count) || !fits(sheet.shared.size(), vertex_count)) {
    return absl::DataLossError(absl::StrCat(path,
                                            ": found arrays of different sizes, expected one value per face "
                                            "or vertex"));
  }
  const auto largest = std::max_element(faces.begin(), faces.end());
  if (largest != faces.end() && *largest >= vertex_count) {
    return absl::DataLossError(
        absl::StrCat(path, ": found vertex index ", *largest, ", expected an index below ", vertex_count));
  }
  if (!std::all_of(vertices.begin(), vertices.end(), [](double v) { return std::isfinite(v); })) {
    return absl::DataLossError(path + ": found a coordinate that is not a number");
  }
  sheet.vertices = InThrees<Eigen::Vector3d>(vertices);
  sheet.faces = InThrees<Triangle>(faces);
  sheet.colors = InThrees<Rgb>(colors);
  return sheet;
}

}  // namespace tessera
