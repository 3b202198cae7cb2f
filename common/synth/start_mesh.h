// The coarse start mesh as volumetric reconstruction gives it: noisy occupancy on a voxel grid, then marching cubes.
#ifndef TESSERA_COMMON_SYNTH_START_MESH_H_
#define TESSERA_COMMON_SYNTH_START_MESH_H_

#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/synth/plan.h"
#include "common/synth/surface.h"

namespace tessera {

inline constexpr double kVoxelPerGsd = 5.0;  // how coarse the start mesh is; part of what is called its difficulty

// A part of the start mesh, one block's cells. Two parts agree on the vertices of the border between them: those have
// the same keys and the same positions to the last bit.
struct StartChunk {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<uint64_t> keys;  // place of each vertex on the global lattice; kNoKey for one inside a cell
  std::vector<Triangle> faces;
  std::vector<uint8_t> true_labels;   // class of the nearest true surface, a face; the measure
  std::vector<uint8_t> right_labels;  // what a face is labelled where labelling works: its orientation counts too
  std::vector<uint8_t> wrong_labels;  // ... and where it fails
  std::vector<float> doubt;           // labelling fails first where this is highest; about standard normal, correlated

  static constexpr uint64_t kNoKey = ~0ull;
  // Whether vertex v lies on the border of the chunk, so that another chunk may have it too.
  std::vector<bool> on_border;
};

// Gives the solids of a block; called for neighbours too, from several threads at once.
class BlockSource {
 public:
  virtual ~BlockSource() = default;
  virtual const BlockSolids& Solids(int column, int row) const = 0;
};

StartChunk ExtractStartChunk(const CityPlan& plan, const BlockSource& source, int column, int row);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_START_MESH_H_
