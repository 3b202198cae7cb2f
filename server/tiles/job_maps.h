// The maps of jobs, read from their surveys and kept in memory.
#pragma once

#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "server/leases/dispatch_core.h"
#include "server/tiles/point_locator.h"
#include "server/tiling/ground_map.h"

namespace tessera {

struct JobMap {
  GroundMap ground;
  // Of the views of `ground`: centre and optical axis in the frame of the 3D tiles; axis 0: not known.
  std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> views_in_tiles;
  StatusOr<PointLocator> locator = absl::UnknownError("");
};

// Thread-safe. Keeps the maps of the last kKept jobs that were asked for. A map is made by one call; the calls that
// need the same one wait for it. The core's mutex is not held while a survey is read.
class JobMaps {
 public:
  static constexpr size_t kKept = 8;

  // `core` must outlive this.
  explicit JobMaps(DispatchCore& core) : core_(core) {}

  // Null if the job has no survey yet. Without tiles until they are planned. NOT_FOUND for an unknown job; errors of
  // the blob store, NOT_FOUND if the survey is no longer stored.
  StatusOr<std::shared_ptr<const JobMap>> Of(const std::string& job);

 private:
  // What a map is made of. Equal sources of a job give equal maps.
  struct Source {
    int job = -1;
    Digest survey;
    int tiles_from = -1;  // index of the task whose parameters have the cores of all tiles; -1: not planned yet
    friend bool operator==(const Source&, const Source&) = default;
  };
  struct Entry {
    Source source;
    std::mutex making;  // guards `map`
    std::shared_ptr<const JobMap> map;
  };

  // Needs the core's mutex.
  static std::optional<Source> FindSource(const Job& job, int index);
  std::shared_ptr<Entry> EntryOf(const Source& source);
  StatusOr<std::shared_ptr<const JobMap>> Make(const Source& source) const;

  DispatchCore& core_;
  std::mutex mutex_;                           // of entries_
  std::list<std::shared_ptr<Entry>> entries_;  // the last used first
};

}  // namespace tessera
