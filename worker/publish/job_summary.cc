#include "worker/publish/job_summary.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/exporting/export_scene.h"
#include "common/exporting/survey_sheets.h"
#include "worker/publish/fit_summary.h"

namespace tessera {
namespace {

using nlohmann::json;

json DisplacementStatistics(std::span<const double> lengths_m, double sum_squared_m2) {
  if (lengths_m.empty()) return json::object();
  const size_t count = lengths_m.size();
  return {{"rms_m", std::sqrt(sum_squared_m2 / static_cast<double>(count))},
          {"median_m", NthSmallest(lengths_m, count / 2)},
          {"p90_m", NthSmallest(lengths_m, count * 9 / 10)},
          {"max_m", *std::max_element(lengths_m.begin(), lengths_m.end())}};
}

// Share of the area per class; faces without label under "unlabelled".
json AreaShares(const std::vector<double>& areas_m2, double total_m2, const std::vector<SceneClass>& classes) {
  json shares = json::object();
  for (size_t l = 0; l < classes.size(); ++l) shares[classes[l].name] = total_m2 > 0 ? areas_m2[l] / total_m2 : 0;
  if (areas_m2.back() > 0) shares["unlabelled"] = areas_m2.back() / total_m2;
  return shares;
}

// Differences between tiles at the vertices that several of them compute, summed over all steps.
json SeamStatistics(const std::vector<json>& tiles) {
  int64_t samples = 0, different = 0;
  double farthest_m = 0;
  json where = json::array();
  for (const json& tile : tiles) {
    const json seam = tile.value("seams", json::object());
    samples += seam.value("samples", int64_t{0});
    const int64_t of_tile = seam.value("different", int64_t{0});
    if (of_tile > 0) where.push_back(tile.at("tile"));
    different += of_tile;
    farthest_m = std::max(farthest_m, seam.value("farthest_m", 0.0));
  }
  return {{"samples", samples}, {"different", different}, {"farthest_m", farthest_m}, {"tiles", where}};
}

}  // namespace

double NthSmallest(std::span<const double> values, size_t n) {
  // For numbers >= 0, the order of the bit patterns is that of the numbers. Determines the answer 16 bits at a time.
  uint64_t found = 0, mask = 0;
  std::vector<size_t> counts(size_t{1} << 16);
  for (int shift = 48; shift >= 0; shift -= 16) {
    std::fill(counts.begin(), counts.end(), 0);
    for (const double value : values) {
      const auto bits = std::bit_cast<uint64_t>(value);
      if ((bits & mask) == found) ++counts[bits >> shift & 0xffff];
    }
    size_t digit = 0;
    while (digit + 1 < counts.size() && n >= counts[digit]) n -= counts[digit++];
    found |= static_cast<uint64_t>(digit) << shift;
    mask |= uint64_t{0xffff} << shift;
  }
  return std::bit_cast<double>(found);
}

StatusOr<ResultStatistics> ResultStatistics::Create(const std::string& scratch_folder, size_t classes) {
  TESSERA_ASSIGN_OR_RETURN(auto lengths_m, ScratchList<double>::Create(scratch_folder));
  return ResultStatistics(std::move(lengths_m), classes);
}

void ResultStatistics::AddVertex(const Eigen::Vector3d& before, const Eigen::Vector3d& after) {
  const double length_m = (after - before).norm();
  lengths_m_.Append(length_m);
  sum_squared_m2_ += length_m * length_m;
}

void ResultStatistics::AddFace(double area_before_m2, int32_t label_before, double area_after_m2, int32_t label_after) {
  const size_t unlabelled = areas_before_m2_.size() - 1;
  ++faces_;
  label_changes_ += label_before != label_after;
  areas_before_m2_[label_before < 0 ? unlabelled : static_cast<size_t>(label_before)] += area_before_m2;
  areas_after_m2_[label_after < 0 ? unlabelled : static_cast<size_t>(label_after)] += area_after_m2;
  total_before_m2_ += area_before_m2;
  total_after_m2_ += area_after_m2;
}

StatusOr<std::string> MakeReport(const Survey& survey, ResultStatistics statistics,
                                 const std::vector<ReportedTile>& tiles) {
  TESSERA_ASSIGN_OR_RETURN(const ScratchArray<double> lengths_m, statistics.lengths_m_.Finish());
  TESSERA_ASSIGN_OR_RETURN(const ExportScene scene, ExportSceneOf(survey));
  std::vector<json> tile_reports;
  for (const ReportedTile& tile : tiles) {
    tile_reports.push_back(json::parse(tile.report));
    tile_reports.back()["tile"] = tile.tile;
    if (tile.quarantined) tile_reports.back()["quarantined"] = true;
    tile_reports.back().erase("fit");
  }
  const std::vector<FitOfTile> fits = FitsOf(tiles);
  for (const FitOfTile& of_tile : fits) {
    const auto report = std::find_if(tile_reports.begin(), tile_reports.end(),
                                     [&](const json& tile) { return tile.at("tile") == of_tile.tile; });
    (*report)["fit"] = json::parse(FitShares(of_tile.fit.all));
  }
  json class_names = json::array();
  for (const SceneClass& c : survey.classes) class_names.push_back(c.name);
  json skipped = json::array();
  for (const auto& [name, reason] : survey.skipped_images) skipped.push_back({{"name", name}, {"reason", reason}});
  const json shares_before = AreaShares(statistics.areas_before_m2_, statistics.total_before_m2_, survey.classes);
  const json shares_after = AreaShares(statistics.areas_after_m2_, statistics.total_after_m2_, survey.classes);
  json report = {{"scene", survey.scene_name},
                 {"frame", json::parse(ExportSceneToJson(scene))},
                 {"gsd_m", survey.gsd_m},
                 {"views", survey.views.size()},
                 {"skipped_images", skipped},
                 {"classes", class_names},
                 {"input", {{"vertices", survey.input_vertices}, {"faces", survey.input_faces}}},
                 {"output", {{"vertices", lengths_m.size()}, {"faces", statistics.faces_}}},
                 {"displacement", DisplacementStatistics(lengths_m.values(), statistics.sum_squared_m2_)},
                 {"label_changes", statistics.label_changes_},
                 {"area_share_before", shares_before},
                 {"area_share_after", shares_after},
                 {"seams", SeamStatistics(tile_reports)},
                 {"fit_change", json::parse(FitSummary(fits, survey))},
                 {"tiles", tile_reports},
                 {"warnings", survey.warnings}};
  if (json views = json::parse(ViewNamesToJson(survey)); !views.empty()) report["views_of_sheets"] = std::move(views);
  if (!survey.fit.empty()) {
    const json fit = json::parse(survey.fit, nullptr, /*allow_exceptions=*/false);
    if (!fit.is_discarded()) report["fit"] = fit;
  }
  return report.dump(2) + "\n";
}

}  // namespace tessera
