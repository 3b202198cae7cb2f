#include "worker/publish/fit_summary.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera {
namespace {

using nlohmann::json;

constexpr size_t kMostPlaces = 20;  // in a list of tiles or images

struct WholeFit {
  FitChange all;
  std::vector<const FitOfTile*> worse_tiles;
  std::vector<std::pair<std::string, FitChange>> worse_images;
};

WholeFit Whole(const std::vector<FitOfTile>& tiles, const Survey& survey) {
  WholeFit whole;
  std::map<int32_t, FitChange> views;
  for (const FitOfTile& tile : tiles) {
    whole.all.Add(tile.fit.all);
    if (tile.fit.all.IsWorse()) whole.worse_tiles.push_back(&tile);
    for (const auto& [view, change] : tile.fit.views) views[view].Add(change);
  }
  for (const auto& [view, change] : views) {
    if (!change.IsWorse()) continue;
    const bool named =
        view >= 0 && view < static_cast<int32_t>(survey.views.size()) && !survey.views[view].name.empty();
    whole.worse_images.emplace_back(named ? survey.views[view].name : absl::StrCat("number ", view), change);
  }
  return whole;
}

double Share(int64_t part, int64_t patches) {
  return patches > 0 ? static_cast<double>(part) / static_cast<double>(patches) : 0;
}

json SharesToJson(const FitChange& change) {
  return {{"patches", change.patches},
          {"above_chance_start", Share(change.start, change.patches)},
          {"above_chance_result", Share(change.result, change.patches)},
          {"became_worse", Share(change.lost, change.patches)},
          {"became_better", Share(change.gained, change.patches)}};
}

std::string SharesText(const FitChange& change) {
  return absl::StrFormat("of %d patches of the images, %.1f %% correlate worse than at the start and %.1f %% better",
                         change.patches, 100 * Share(change.lost, change.patches),
                         100 * Share(change.gained, change.patches));
}

Eigen::Vector3d InScene(const Survey& survey, const Eigen::Vector3d& p_local) {
  return survey.rotation_local_from_scene.transpose() * p_local + survey.origin_in_scene;
}

// The first of `texts`, and how many more there are.
template <class Items, class Text>
std::string ListText(const Items& items, const Text& text) {
  std::string list;
  for (size_t i = 0; i < std::min(items.size(), kMostPlaces); ++i) {
    absl::StrAppend(&list, i == 0 ? "" : ", ", text(items[i]));
  }
  if (items.size() > kMostPlaces) absl::StrAppend(&list, " and ", items.size() - kMostPlaces, " more");
  return list;
}

}  // namespace

std::vector<FitOfTile> FitsOf(const std::vector<ReportedTile>& tiles) {
  std::vector<FitOfTile> fits;
  for (const ReportedTile& tile : tiles) {
    const json report = json::parse(tile.report);
    if (const auto fit = report.find("fit"); fit != report.end()) {
      fits.push_back({tile.tile, ParseTileFit(fit->dump())});
    }
  }
  return fits;
}

std::string FitShares(const FitChange& change) { return SharesToJson(change).dump(); }

std::string FitSummary(const std::vector<FitOfTile>& tiles, const Survey& survey) {
  const WholeFit whole = Whole(tiles, survey);
  json summary = SharesToJson(whole.all), worse_tiles = json::array(), worse_images = json::array();
  for (const FitOfTile* tile : whole.worse_tiles) {
    const Eigen::Vector3d at = InScene(survey, tile->fit.centre_m);
    worse_tiles.push_back(SharesToJson(tile->fit.all));
    worse_tiles.back()["tile"] = tile->tile;
    worse_tiles.back()["centre"] = {at.x(), at.y(), at.z()};
  }
  for (const auto& [name, change] : whole.worse_images) {
    worse_images.push_back(SharesToJson(change));
    worse_images.back()["image"] = name;
  }
  summary["worse"] = whole.all.IsWorse();
  summary["worse_tiles"] = worse_tiles;
  summary["worse_images"] = worse_images;
  return summary.dump();
}

Warnings FitWarnings(const std::vector<FitOfTile>& tiles, const Survey& survey) {
  const WholeFit whole = Whole(tiles, survey);
  Warnings warnings;
  if (whole.all.IsWorse()) {
    warnings.push_back(absl::StrCat("the result fits the images worse than the start mesh: ", SharesText(whole.all),
                                    ": do not use it before tessera check finds no fault in poses, images and mesh"));
  }
  if (!whole.worse_tiles.empty()) {
    warnings.push_back(absl::StrCat("the images fit worse than at the start in ", whole.worse_tiles.size(),
                                    " tiles: ", ListText(whole.worse_tiles, [&](const FitOfTile* tile) {
                                      const Eigen::Vector3d at = InScene(survey, tile->fit.centre_m);
                                      return absl::StrFormat("tile %d around (%.1f, %.1f, %.1f)", tile->tile, at.x(),
                                                             at.y(), at.z());
                                    })));
  }
  if (!whole.worse_images.empty()) {
    warnings.push_back(absl::StrCat("the result fits these images worse than the start: ",
                                    ListText(whole.worse_images, [](const auto& image) { return image.first; }),
                                    ": check their poses"));
  }
  return warnings;
}

}  // namespace tessera
