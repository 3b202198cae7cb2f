// What the tiles' results say together: whose say counts how much at a vertex, and what a tile goes on from.
#ifndef TESSERA_WORKER_TASKS_TILE_BLEND_H_
#define TESSERA_WORKER_TASKS_TILE_BLEND_H_

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/tile/task_parameters.h"
#include "worker/tasks/tile_files.h"

namespace tessera {

// A partition of unity over global ids. Its shares come in the order of the tiles, so whoever asks computes the same
// bytes. Keeps pointers to its arguments. Thread-safe.
class TileBlend {
 public:
  struct Share {
    size_t result = 0;   // index among the results
    uint32_t index = 0;  // of the vertex or face in it
    double weight = 0;   // not divided by the sum
  };

  // DATA_LOSS, with what the tile `reader` found, if `results` are not those of `tiles`, one each in that order, or
  // not of `classes` classes.
  static StatusOr<TileBlend> Create(int reader, int classes, const GroundPlane& ground, double blend_m,
                                    const std::vector<TileResult>& results, const std::vector<TileParameters>& tiles);

  // Of those that have the vertex or face and whose core is nearer to `at` (its start) than the blend's width
  // (BlendWeight); if there are none, the first that has it. DATA_LOSS if none has it.
  StatusOr<std::vector<Share>> OfVertex(uint32_t id, const Eigen::Vector3d& at) const;
  StatusOr<std::vector<Share>> OfFace(uint32_t id, const Eigen::Vector3d& at) const;

 private:
  // Finds where a global id lies in a result.
  class IdIndex {
   public:
    explicit IdIndex(const std::vector<uint32_t>& ids);
    bool Find(uint32_t id, uint32_t* at) const;

   private:
    std::vector<uint32_t> order_;
    const std::vector<uint32_t>* ids_;
  };

  TileBlend() = default;
  StatusOr<std::vector<Share>> Of(const char* what, const std::vector<IdIndex>& index, uint32_t id,
                                  const Eigen::Vector3d& at) const;

  int reader_ = 0;
  const GroundPlane* ground_ = nullptr;
  double blend_m_ = 0;
  const std::vector<TileParameters>* tiles_ = nullptr;
  std::vector<IdIndex> vertex_index_, face_index_;
};

// What a tile goes on from after an exchange, for all of its package; empty: the package itself.
struct TileState {
  std::vector<Eigen::Vector3d> positions, level_start;  // as TileResult's
  std::vector<int32_t> labels;
  std::string report = "{}";  // the tile's own
};

// Vertices as blended; labels as the tile has them whose core holds the face. `results` must hold every tile whose core
// or blend the package touches. DATA_LOSS if they do not fit together.
StatusOr<TileState> JoinResults(const TilePackage& package, const std::vector<TileResult>& results,
                                const std::vector<TileParameters>& tiles, double blend_m);

// Where the tiles have a vertex together: equal to them, to the last bit, where they agree. `values`: of a result, by
// Share::index.
template <class Values>
Eigen::Vector3d BlendedPosition(const std::vector<TileBlend::Share>& shares, const Values& values) {
  const Eigen::Vector3d first = values(shares[0]);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double total = shares[0].weight;
  for (size_t i = 1; i < shares.size(); ++i) {
    sum += shares[i].weight * (values(shares[i]) - first);
    total += shares[i].weight;
  }
  return first + sum / total;
}

// Drops what lies farther from the core than the blend reaches, and has no part in a face that lies nearer.
void KeepBlended(const TilePackage& package, const CellRect& core, double blend_m, TileResult* result);

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_TILE_BLEND_H_
