// Sparse 3D points of the COLMAP model: surface points seen in several views, with noisy observations.
#pragma once

#include <array>
#include <vector>

#include "common/synth/city/city_scene.h"
#include "common/synth/photos/flight.h"

namespace tessera {

struct SparsePoint {
  Eigen::Vector3d position;
  std::array<uint8_t, 3> color_rgb;
  double error_px;  // mean reprojection error
  struct Observation {
    int view;  // index in the flight
    double x_px, y_px;
  };
  std::vector<Observation> track;  // at least three views
};

// Casts `count` rays through random pixels of `views` (indices into `flight`) at `scene`, and returns the hits that at
// least three views of the flight see.
std::vector<SparsePoint> MakeSparsePoints(const CityScene& scene, const std::vector<SynthView>& flight,
                                          const std::vector<int>& views, int count, uint64_t seed);

}  // namespace tessera
