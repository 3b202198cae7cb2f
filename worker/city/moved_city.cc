#include "worker/city/moved_city.h"

#include <nlohmann/json.hpp>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

constexpr char kMovedPositions[] = "positions", kMovedLabels[] = "labels", kMovedConfidence[] = "confidence",
               kMovedBoxes[] = "cell_boxes";

static_assert(sizeof(Eigen::AlignedBox3d) == 6 * sizeof(double));

}  // namespace

Status WriteMovedCity(const std::string& path, const MovedSpans& moved) {
  nlohmann::json metadata = nlohmann::json::object();
  for (const auto& [tile, report] : moved.reports) metadata[std::to_string(tile)] = report;
  TESSERA_ASSIGN_OR_RETURN(
      const auto file, ArrayFileWriter::Create(path, metadata.dump(),
                                               {{kMovedPositions, std::vector<double>(), 3 * moved.positions.size()},
                                                {kMovedLabels, std::vector<int32_t>(), moved.labels.size()},
                                                {kMovedConfidence, std::vector<float>(), moved.confidence.size()},
                                                {kMovedBoxes, std::vector<double>(), 6 * moved.cell_boxes.size()}}));
  const auto* const coordinates = reinterpret_cast<const double*>(moved.positions.data());
  file->Append(kMovedPositions, std::span(coordinates, 3 * moved.positions.size()));
  file->Append(kMovedLabels, moved.labels);
  file->Append(kMovedConfidence, moved.confidence);
  const auto* const corners = reinterpret_cast<const double*>(moved.cell_boxes.data());
  file->Append(kMovedBoxes, std::span(corners, 6 * moved.cell_boxes.size()));
  return file->Finish();
}

StatusOr<MovedCity> MovedCity::Open(const std::string& path, int64_t vertices, int64_t faces, size_t cells) {
  MovedCity moved;
  TESSERA_ASSIGN_OR_RETURN(moved.file_, MappedArrays::Open(path));
  TESSERA_ASSIGN_OR_RETURN(const auto coordinates, moved.file_.Verified<double>(kMovedPositions, 3 * vertices));
  moved.spans_.positions = {reinterpret_cast<const Eigen::Vector3d*>(coordinates.data()), coordinates.size() / 3};
  TESSERA_ASSIGN_OR_RETURN(moved.spans_.labels, moved.file_.Verified<int32_t>(kMovedLabels, faces));
  TESSERA_ASSIGN_OR_RETURN(moved.spans_.confidence, moved.file_.Verified<float>(kMovedConfidence, faces));
  TESSERA_ASSIGN_OR_RETURN(const auto corners, moved.file_.Verified<double>(kMovedBoxes, 6 * cells));
  moved.spans_.cell_boxes = {reinterpret_cast<const Eigen::AlignedBox3d*>(corners.data()), cells};
  const auto metadata = nlohmann::json::parse(moved.file_.metadata(), nullptr, /*allow_exceptions=*/false);
  if (!metadata.is_object()) return absl::DataLossError(path + ": found no reports of tiles in the metadata");
  for (const auto& [tile, report] : metadata.items()) {
    int number = 0;
    if (!absl::SimpleAtoi(tile, &number) || !report.is_string() ||
        !nlohmann::json::accept(report.get_ref<const std::string&>())) {
      return absl::DataLossError(absl::StrCat(path, ": found the entry '", tile, "', expected a tile and its report"));
    }
    moved.spans_.reports[number] = report.get<std::string>();
  }
  return moved;
}

std::string MovedCity::ReportOf(int tile) const {
  const auto found = spans_.reports.find(tile);
  return found == spans_.reports.end() ? "{}" : found->second;
}

}  // namespace tessera
