#include "server/tiles/tiles.h"

#include <algorithm>
#include <mutex>
#include <nlohmann/json.hpp>
#include <utility>

#include "server/jobs/waiting_for.h"

namespace tessera {
namespace {

constexpr int kTilesOfHold = 100;  // visited per hold of the core's mutex

// The value that the solver reports; 0 if there is none.
double ConfidenceIn(const std::string& stats) {
  if (stats.empty()) return 0;
  const auto json = nlohmann::json::parse(stats, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) return 0;
  const auto found = json.find("mean_confidence");
  return found != json.end() && found->is_number() ? std::clamp(found->get<double>(), 0.0, 1.0) : 0;
}

}  // namespace

StatusOr<TilePage> Tiles::ListTiles(const std::string& name, int first, int count) {
  const StatusOr<std::shared_ptr<const JobMap>> read = maps_.Of(name);
  // An unreadable survey hides the places.
  const GroundMap* const map = read.ok() && *read != nullptr ? &(*read)->ground : nullptr;
  const int on_map = map == nullptr ? 0 : static_cast<int>(map->tiles.size());
  TilePage page;
  bool ended = false, more = true;
  int tile = std::max(0, first);
  while (more && static_cast<int>(page.tiles.size()) < count) {
    std::lock_guard lock(core_.mutex());
    TESSERA_ASSIGN_OR_RETURN(const int index, core_.ledger().FindJob(name));
    const Job& job = core_.ledger().jobs()[index];
    const LeaseTable& leases = core_.lease_table();
    const int64_t now_us = core_.environment().clock->MonotonicUs();
    const std::map<int, TaskRef> running = RunningByTile(core_.ledger(), index, leases);
    const std::string waits_for =
        WaitingFor(core_.ledger(), index, leases, core_.journal().trouble(), planning_.room(), now_us);
    const std::map<int, TileTotals>& totals = job.totals.tiles();
    const int end = std::max(on_map, totals.empty() ? 0 : totals.rbegin()->first + 1);
    ended = HasEnded(job.header.state);
    auto next = totals.lower_bound(tile);
    for (int seen = 0; seen < kTilesOfHold && tile < end && static_cast<int>(page.tiles.size()) < count;
         ++seen, ++tile) {
      const MapTile* const place = tile < on_map ? &map->tiles[tile] : nullptr;
      if (next != totals.end() && next->first == tile) {
        page.tiles.push_back({StatusOfTile(core_.ledger(), index, tile, leases, running, waits_for),
                              place == nullptr ? MapTile() : *place});
        ++next;
      } else if (place != nullptr && !place->core.empty()) {  // without tasks: an update does not refine it
        ListedTile& kept = page.tiles.emplace_back(ListedTile{{}, *place});
        kept.status.tile = tile;
        kept.status.state = TileProgress::kKept;
        kept.status.progress = 1;
      }
    }
    more = tile < end;
  }
  if (more) page.next = tile;
  if (ended) TESSERA_RETURN_IF_ERROR(core_.Durable());  // an end is shown only when durable
  for (ListedTile& each : page.tiles) each.confidence = ConfidenceIn(each.status.last_stats);
  return page;
}

StatusOr<ViewPage> Tiles::ListViews(const std::string& name, int first, int count) {
  TESSERA_ASSIGN_OR_RETURN(const std::shared_ptr<const JobMap> map, maps_.Of(name));
  ViewPage page;
  if (map == nullptr) return page;
  const int size = static_cast<int>(map->ground.views.size()), begin = std::clamp(first, 0, size),
            end = std::min<int64_t>(size, int64_t{begin} + count);
  for (int i = begin; i < end; ++i) {
    const auto& [centre, axis] = map->views_in_tiles[i];
    page.views.push_back({map->ground.views[i], centre, axis});
  }
  if (end < size) page.next = end;
  return page;
}

StatusOr<PointOnMap> Tiles::LocatePoint(const std::string& name, const Eigen::Vector3d& p_in_tiles) {
  TESSERA_ASSIGN_OR_RETURN(const std::shared_ptr<const JobMap> map, maps_.Of(name));
  if (map == nullptr) return absl::NotFoundError(name + " has no survey yet");
  TESSERA_RETURN_IF_ERROR(map->locator.status());
  PointOnMap found;
  TESSERA_ASSIGN_OR_RETURN(found.point, map->locator->Locate(p_in_tiles));
  found.on_ground = map->locator->OnGround(found.point);
  const double x = found.on_ground.x(), y = found.on_ground.y();
  const auto owns = [&](const MapTile& tile) {
    return std::any_of(tile.core.begin(), tile.core.end(), [&](const GroundRect& rect) {
      return x >= rect.x0_m && x < rect.x1_m && y >= rect.y0_m && y < rect.y1_m;
    });
  };
  const std::vector<MapTile>& tiles = map->ground.tiles;
  const auto owner = std::find_if(tiles.begin(), tiles.end(), owns);
  if (owner != tiles.end()) found.tile = static_cast<int>(owner - tiles.begin());
  return found;
}

}  // namespace tessera
