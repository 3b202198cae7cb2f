// A survey as ingest would write it for a city that is not there: for benchmarks and tests of planning.
#pragma once

#include <cstdint>

#include "common/job/survey.h"

namespace tessera {

struct SyntheticCity {
  int images = 10000;  // of a rig of five cameras: one looks down, four look out at 45 degrees
  double faces = 100e6;
  double gsd_m = 0.1;
  double dense_share = 4;  // faces of a cell in the middle of the town, as a multiple of those at its edge
  int image_width = 3000, image_height = 2250;  // so that about 23 views a direction see a place
  uint64_t seed = 1;
};

// A square town; about 1,100 faces a cell, heights and cells' views as a flight in parallel strips gives them.
Survey MakeSyntheticSurvey(const SyntheticCity& city);

}  // namespace tessera
