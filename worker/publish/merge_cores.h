// Merges the tiles' cores into the city's result by streaming, without loading the city.
#pragma once

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

// A face whose corners changed by edge flips.
struct FlippedFace {
  uint32_t face;      // index in the core's list
  Triangle vertices;  // indices in the core's list
};

// The final state of a tile's core.
struct CoreSpans : StateSpans {
  CoreSpans() = default;
  explicit CoreSpans(const StateSpans& state) : StateSpans(state) {}
  std::span<const FlippedFace> flipped;  // ascending
};

// Maps ascending ids with gaps to consecutive indices.
class IdIndex {
 public:
  // Adds the next id, which must exceed all previous ones.
  void Add(uint32_t id) {
    if (id != next_) gaps_.push_back({id, id - count_});
    next_ = id + 1;
    ++count_;
  }
  // Index of an id that was added.
  uint32_t operator()(uint32_t id) const {
    const auto after =
        std::upper_bound(gaps_.begin(), gaps_.end(), id, [](uint32_t i, const Gap& gap) { return i < gap.end; });
    return after == gaps_.begin() ? id : id - std::prev(after)->missing;
  }

 private:
  struct Gap {
    uint32_t end, missing;  // one past the id; number of unused ids below it
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
  Triangle vertices;  // global ids; after edge flips
  double area_before_m2 = 0;
  int32_t label_before = -1;
  uint32_t input_face = 0;
  int32_t label = -1;
  float confidence = 0;
};

// Iterates over a city and its cores in order of global ids. The city and the cores' memory must outlive it. Memory
// is bounded by the number of blocks and cores; each is read sequentially. Not thread-safe.
class CoreMerger {
 public:
  // Reads and verifies the city's blocks. Errors as CityReader::Block.
  static StatusOr<CoreMerger> Create(const CityReader& city, std::vector<CoreSpans> cores);

  // Visits every vertex of the city by id. DATA_LOSS if a vertex is in no core, if cores differ in any bit of its
  // position, or if a core has a vertex that is not in the city.
  Status ForEachVertex(const std::function<void(const MergedVertex&)>& visit) const;
  // Visits every face of the city by id. DATA_LOSS if a face is in no core or in two, or if a core has a face that is
  // not in the city.
  Status ForEachFace(const std::function<void(const MergedFace&)>& visit) const;

 private:
  const CityReader* city_ = nullptr;
  std::vector<CityBlock> blocks_;
  std::vector<CoreSpans> cores_;
};

}  // namespace tessera
