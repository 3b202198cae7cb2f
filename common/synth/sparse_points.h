// The sparse points of the COLMAP model: places that several views see, with slightly noisy observations.
#ifndef TESSERA_COMMON_SYNTH_SPARSE_POINTS_H_
#define TESSERA_COMMON_SYNTH_SPARSE_POINTS_H_

#include <array>
#include <vector>

#include "common/synth/city_scene.h"
#include "common/synth/flight.h"

namespace tessera {

struct SparsePoint {
  Eigen::Vector3d position;
  std::array<uint8_t, 3> color_rgb;
  double error_px;  // mean distance of the observations from the projection
  struct Observation {
    int view;  // index in the whole flight
    double x_px, y_px;
  };
  std::vector<Observation> track;  // at least three views
};

// `count` attempts on rays through random pixels of `views` (indices into `flight`), all seen through `scene`.
std::vector<SparsePoint> MakeSparsePoints(const CityScene& scene, const std::vector<SynthView>& flight,
                                          const std::vector<int>& views, int count, uint64_t seed);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_SPARSE_POINTS_H_
