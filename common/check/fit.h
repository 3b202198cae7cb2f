// Whether images, poses and mesh of a scene belong together. Patches of one image are warped through the mesh into
// another image and compared there with what is found around them.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/geometry/mesh.h"
#include "common/scene/scene.h"

namespace tessera {

struct FitOptions {
  int pairs = 100;    // of images, spread over the scene
  int patches = 200;  // of each pair
};

// What the patches of an image, a camera or a scene say. Pixels of the images.
struct FitShare {
  int pairs = 0;
  int64_t patches = 0;      // with texture, seen by both images of a pair
  double above_chance = 0;  // share of them that correlate better than 95 % of patches at random places
  // Medians over the patches with a distinct best match, of its distance from where the mesh puts it: across the
  // epipolar line (an error of cameras) and along it (of cameras or mesh). -1: too few such patches.
  double across_px = -1, along_px = -1;
};

// Share of patches that correlate by chance: by the definition of FitShare::above_chance.
inline constexpr double kChanceShare = 0.05;

struct FitPairShare {
  int reference = 0, other = 0;  // views
  FitShare share;
  double signed_across_px = 0;  // median of the offsets across the epipolar line, if share.across_px >= 0
};

struct SceneFit {
  FitShare all;
  std::vector<FitShare> views;      // of each view
  std::vector<FitPairShare> pairs;  // with enough patches
  // The share above chance that a scene must exceed to have anything in common with its images: three times the share
  // by chance, so that most matches are true ones, and five standard deviations above it. The deviation is that of the
  // patches at random places, between pairs.
  double least_above_chance = 3 * kChanceShare;
  std::vector<int> misplaced;  // views whose pairs disagree with those of the others
  // How far the poses of the other views are wrong, in pixels of the images: estimated from the offsets across the
  // epipolar lines that all patches of a pair have in common. -1: too few pairs.
  double pose_error_px = -1;
  // The translation of the mesh (local frame) and the relative changes of the cameras' focal lengths that together
  // explain the offsets best.
  Eigen::Vector3d mesh_shift_m = Eigen::Vector3d::Zero();
  std::vector<LensModel> cameras;       // the different ones
  std::vector<int> camera_of;           // of each view
  std::vector<double> focal_changes;    // of each of `cameras`
  std::vector<FitShare> camera_shares;  // of each of `cameras`: pairs with at least one of its views
  // How much better the best of some trial shifts of the mesh to the sides matches, in standard deviations of the
  // number of patches that match more or less than in place by chance.
  double sideways_deviations = 0;
};

// Share of patches above chance below which a scene fits badly: 37 % of the patches match for another reason than
// chance, so the mesh is wrong at most places. Good start meshes, down to block models, have 60 to 95 %.
inline constexpr double kBadFit = 0.4;
// The fit of fewer patches is not judged.
inline constexpr int kJudgedPatches = 200;

// The surface that is measured: repaired, local frame. What it refers to must outlive it.
struct FitSurface {
  FitSurface(const TriangleMesh& all) : mesh(all), occluders(&all) {}
  // `hides`: what hides points of a mesh that is too large for it; its surface is at most `error_m` from that of
  // `large`.
  FitSurface(const MeshSpans& large, const TriangleMesh& hides, double error_m)
      : mesh(large), occluders(&hides), margin_m(error_m) {}

  MeshSpans mesh;
  const TriangleMesh* occluders;
  double margin_m = 0;
};

// Reads the images of the chosen pairs. The result does not depend on the number of threads. Without a pair of images
// that see the same surface, all.pairs is 0. `fetch`: as InspectedFiles. Errors: those of reading and fetching images,
// and CANCELLED by `control`.
StatusOr<SceneFit> MeasureFit(const SceneDescription& scene, const FitSurface& surface, const FitOptions& options,
                              const TaskControl& control, const FetchFiles& fetch = {});

}  // namespace tessera
