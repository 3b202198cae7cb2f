// The vertices of all sheets of a city, each once.
#pragma once

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/exporting/sheet.h"
#include "common/geometry/position_index.h"

namespace tessera {

// The numbers of a sheet's vertices in the city.
struct CityVertices {
  std::vector<uint32_t> numbers;       // per vertex of the sheet
  std::vector<uint32_t> new_vertices;  // the vertices of the sheet that no earlier one has, in the order of numbers
  std::vector<int32_t> labels;         // per vertex: as VertexLabels, by the faces of all sheets
};

// Numbers the vertices of sheets that are read one after the other. Vertices on the borders of sheets at the same
// position, bit for bit, have the same number. Memory: about 60 bytes for each vertex on a border. Not thread-safe.
class WeldedVertices {
 public:
  // RESOURCE_EXHAUSTED if there are more than 2^32 - 1 vertices.
  Status Add(const Sheet& sheet);
  int64_t count() const { return count_; }
  // Of the sheet that was added as number `index`. To be called after all sheets were added.
  CityVertices Of(size_t index, const Sheet& sheet);

 private:
  struct Border {
    uint32_t number = 0;  // in the city
    int32_t label = -1;   // of the first face
    double area = -1;     // of this label's faces, m^2; -1: no face yet
  };

  PositionIndex positions_;
  std::vector<Border> borders_;                                 // by number in positions_
  std::map<std::pair<uint32_t, int32_t>, double> other_areas_;  // (index in borders_, another label)
  std::vector<uint32_t> first_new_;                             // per sheet
  int64_t count_ = 0;
};

}  // namespace tessera
