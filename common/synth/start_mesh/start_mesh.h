// The coarse start mesh, as from volumetric reconstruction: noisy occupancy on a voxel grid, then marching cubes.
#pragma once

#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/synth/city/plan.h"
#include "common/synth/city/surface.h"

namespace tessera {

inline constexpr double kVoxelPerGsd = 5.0;  // voxel size in GSD; part of the scene's difficulty

// A part of the start mesh: the cells of one block. Adjacent parts have bit-identical vertices with equal keys on their
// common border.
struct StartChunk {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<uint64_t> keys;  // lattice edge of each vertex; kNoKey for a vertex inside a cell
  std::vector<Triangle> faces;
  std::vector<uint8_t> true_labels;   // per face: class of the nearest true surface; the reference for accuracy
  std::vector<uint8_t> right_labels;  // per face: label without error; depends on the orientation too
  std::vector<uint8_t> wrong_labels;  // per face: label with error
  std::vector<float> doubt;           // per face: errors occur above a threshold; standard normal, spatially correlated

  static constexpr uint64_t kNoKey = ~0ull;
  // Per vertex: whether it lies on the border of the chunk, so that another chunk may contain it too.
  std::vector<bool> on_border;
};

// Provides the solids of blocks, including neighbours. Called concurrently from several threads.
class BlockSource {
 public:
  virtual ~BlockSource() = default;
  virtual const BlockSolids& Solids(int column, int row) const = 0;
};

StartChunk ExtractStartChunk(const CityPlan& plan, const BlockSource& source, int column, int row);

}  // namespace tessera
