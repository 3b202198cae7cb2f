// Locates an occluding contour on a line of pixels that crosses it.
#pragma once

#include <array>

#include "common/imaging/border_trust.h"

namespace tessera {

// Pixels across the contour at its position in the mesh, from inside the nearer surface outwards. Pixel kReach - 1 is
// the last one on the nearer surface.
struct ContourProfile {
  static constexpr int kReach = 6;
  static constexpr int kPixels = 2 * kReach;
  std::array<double, kPixels> front_gain;  // likelihood of the front class minus that of the back class
  std::array<double, kPixels> luminance;   // in [0, 1]
};

struct ContourMeasurement {
  double outward_px = 0;  // offset from the contour of the mesh
  double weight = 0;      // in [0, 1]; 0: no measurement
};

// Position of the image edge near the border between the front and the back class in the likelihoods. The likelihoods
// select the edge, the image gives its position; `trust.bias_px`, the known bias of such borders, is subtracted.
// `trust`: for this ordered pair of classes, in pixels of level 0; times `scale` (2^-level) gives
// pixels of the profile. Weight 0 if the likelihoods have no such border within kReach or are not trusted; a small
// weight if there is no distinct edge.
ContourMeasurement MeasureContour(const ContourProfile& profile, const BorderTrust& trust, double scale);

}  // namespace tessera
