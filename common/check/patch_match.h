// Comparison of two views of a plane patch: how well it correlates, and where it would correlate best.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/imaging/camera.h"
#include "common/imaging/raster.h"

namespace tessera {

// An undistorted image with its camera, in the image's resolution. The image must outlive it.
struct PatchView {
  const FloatImage* luminance = nullptr;
  PosedCamera camera;
};

// A point of a surface with its unit normal, frame of the cameras.
struct SurfacePoint {
  Eigen::Vector3d position, normal;
};

// Half width of a patch, and the farthest shift that is searched, in pixels of the reference.
inline constexpr int kPatchRadius_px = 5, kSearchRadius_px = 8;

struct PatchMatch {
  double correlation = 0;                 // ZNCC of the two views of the patch
  std::vector<float> at_random;           // ZNCC with patches of the other view 10 to 40 px away
  bool distinct = false;                  // a single distinct maximum of the ZNCC lies inside the search radius
  double best = 0;                        // its ZNCC
  Eigen::Vector2d shift_px = {0, 0};      // where it is, in pixels of the reference
  Eigen::Vector2d epipolar_dir = {1, 0};  // unit vector in the reference: how the patch moves if the surface does
  // Derivatives of shift_px if the scene were another: the surface moved along its normal (per metre), and the focal
  // length of the reference or the other view (per relative change).
  Eigen::Vector2d by_surface = {0, 0}, by_reference_focal = {0, 0}, by_other_focal = {0, 0};
};

// Compares the patch of the tangent plane around `point`, which both views see. `seed` chooses the random positions.
// None if the patch leaves an image, has no texture, or appears more than twice as large in one view as in the other.
std::optional<PatchMatch> MatchPatch(const PatchView& reference, const PatchView& other, const SurfacePoint& point,
                                     uint32_t seed);

// PatchMatch::correlation and at_random alone. None where MatchPatch gives none, except that the patch needs no
// surroundings.
struct PatchCorrelation {
  float correlation = 0;
  std::vector<float> at_random;
};
std::optional<PatchCorrelation> CorrelateAtRandom(const PatchView& reference, const PatchView& other,
                                                  const SurfacePoint& point, uint32_t seed);

// PatchMatch::correlation alone. NaN where CorrelateAtRandom gives none.
float CorrelatePatch(const PatchView& reference, const PatchView& other, const SurfacePoint& point);

}  // namespace tessera
