// Putting the city together again from its tiles' cores, without holding it.
#ifndef TESSERA_WORKER_PUBLISH_MERGE_CORES_H_
#define TESSERA_WORKER_PUBLISH_MERGE_CORES_H_

#include <Eigen/Core>
#include <algorithm>
#include <functional>
#include <iterator>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "worker/city/city_file.h"
#include "worker/tile/tile_files.h"

namespace tessera {

// A face whose corners are not those of the city's.
struct FlippedFace {
  uint32_t face;      // its place in the core's list
  Triangle vertices;  // their places in the core's list
};

// A tile's last state.
struct CoreSpans : StateSpans {
  CoreSpans() = default;
  explicit CoreSpans(const StateSpans& state) : StateSpans(state) {}
  std::span<const FlippedFace> flipped;  // ascending
};

// Places in a list of ascending ids of which some are used no more.
class IdPlaces {
 public:
  // The next id, greater than all before.
  void Add(uint32_t id) {
    if (id != next_) gaps_.push_back({id, id - count_});
    next_ = id + 1;
    ++count_;
  }
  // Of an id that was added.
  uint32_t operator()(uint32_t id) const {
    const auto after =
        std::upper_bound(gaps_.begin(), gaps_.end(), id, [](uint32_t i, const Gap& gap) { return i < gap.end; });
    return after == gaps_.begin() ? id : id - std::prev(after)->missing;
  }

 private:
  struct Gap {
    uint32_t end, missing;  // the id behind it; how many are missing below
  };
  std::vector<Gap> gaps_;
  uint32_t next_ = 0, count_ = 0;
};

struct MergedVertex {
  uint32_t id = 0;
  Eigen::Vector3d before, after;  // local frame
};

struct MergedFace {
  uint32_t id = 0;
  Triangle vertices;  // global; flipped where the core says so
  double area_before_m2 = 0;
  int32_t label_before = -1;
  uint32_t input_face = 0;
  int tile = 0;  // whose core has it
  int32_t label = -1;
  float confidence = 0;
};

// Walks a city and its cores, both by global id. All that it is made of must outlive it. Memory is bounded by the
// number of blocks and cores; the data are read front to back within each of them. Not thread-safe.
class CoreMerger {
 public:
  // Checks and reads the city's blocks. Errors as CityReader::Block's.
  static StatusOr<CoreMerger> Create(const CityReader& city, std::vector<CoreSpans> cores);

  // Every vertex of the city by id. DATA_LOSS if one is in no core, if cores have it at different positions (in any
  // bit), or if a core names one that the city has not.
  Status ForEachVertex(const std::function<void(const MergedVertex&)>& visit) const;
  // Every face of the city by id. DATA_LOSS if one is in no core or in two, or if a core names one that the city has
  // not.
  Status ForEachFace(const std::function<void(const MergedFace&)>& visit) const;

 private:
  const CityReader* city_ = nullptr;
  std::vector<CityBlock> blocks_;
  std::vector<CoreSpans> cores_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_PUBLISH_MERGE_CORES_H_
