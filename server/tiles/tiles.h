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

struct ListedView {
  MapView view;
  Eigen::Vector3d in_tiles, axis_in_tiles;  // centre and optical axis in the frame of the 3D tiles; axis 0: not known
};

struct PointOnMap {
  LocatedPoint point;
  Eigen::Vector2d on_ground;  // GroundPlane::Coordinates
  int tile = -1;              // that owns the ground there; -1: none
};

struct ViewPage {
  std::vector<ListedView> views;
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
  // Where a point of the 3D tiles is. NOT_FOUND before there is a survey, or if it is no longer stored; errors of
  // PointLocator.
  StatusOr<PointOnMap> LocatePoint(const std::string& job, const Eigen::Vector3d& p_in_tiles);

 private:
  DispatchCore& core_;
  const PlanningLoop& planning_;
  JobMaps maps_;
};

}  // namespace tessera
