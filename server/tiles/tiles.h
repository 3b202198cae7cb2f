// Lists the tiles and images of jobs, for maps.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/jobs/planning_loop.h"
#include "server/leases/dispatch_core.h"
#include "server/tiles/job_maps.h"
#include "server/tiles/tile_status.h"

namespace tessera {

struct ListedTile {
  TileStatus status;
  MapTile place;          // without a core if the survey cannot be read
  double confidence = 0;  // mean confidence of its labels, in [0, 1]; 0: not known
};

struct TilePage {
  std::vector<ListedTile> tiles;  // ascending
  int next = -1;                  // number of the first tile of the next page; -1: none
};

struct ViewPage {
  std::vector<MapView> views;
  int next = -1;  // index of the first view of the next page; -1: none
};

// Thread-safe. Holds the core's mutex for a bounded number of tiles at a time; the time of a page does not depend on
// the number of tasks of the job. NOT_FOUND for an unknown job.
class Tiles {
 public:
  // Both must outlive this.
  Tiles(DispatchCore& core, const PlanningLoop& planning) : core_(core), planning_(planning), maps_(core) {}

  // At most `count` tiles from number `first`. UNAVAILABLE if the job's end is not durable in time.
  StatusOr<TilePage> ListTiles(const std::string& job, int first, int count);
  // At most `count` images from index `first` of the survey. None before there is a survey; NOT_FOUND if it is no
  // longer stored.
  StatusOr<ViewPage> ListViews(const std::string& job, int first, int count);

 private:
  DispatchCore& core_;
  const PlanningLoop& planning_;
  JobMaps maps_;
};

}  // namespace tessera
