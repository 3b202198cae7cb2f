// The surface of a city after the coarse levels of a job: positions and labels for the city's vertices and faces.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <map>
#include <span>
#include <string>

#include "common/arrays/mapped_arrays.h"
#include "common/base/status.h"

namespace tessera {

// Values per vertex or face of the city, by id, and per cell of its survey. `reports`: TileState::report of each tile
// so far.
struct MovedSpans {
  std::span<const Eigen::Vector3d> positions;  // local frame
  std::span<const int32_t> labels;
  std::span<const float> confidence;  // as in TileState
  // Boxes of the positions of each cell's faces.
  std::span<const Eigen::AlignedBox3d> cell_boxes;
  std::map<int, std::string> reports;
};

Status WriteMovedCity(const std::string& path, const MovedSpans& moved);

// A memory-mapped file of WriteMovedCity. Const members are thread-safe.
class MovedCity {
 public:
  // Reads and verifies the whole file. DATA_LOSS if it is damaged, or unless it has this number of vertices, faces and
  // cells.
  static StatusOr<MovedCity> Open(const std::string& path, int64_t vertices, int64_t faces, size_t cells);
  // Valid as long as this object.
  const MovedSpans& spans() const { return spans_; }
  // Of a tile; "{}" if it has none.
  std::string ReportOf(int tile) const;

 private:
  MappedArrays file_;
  MovedSpans spans_;
};

}  // namespace tessera
