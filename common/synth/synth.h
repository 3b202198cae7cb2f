// `tessera synth`: a procedural city with exact truth, as a scene (images, cameras, likelihoods, coarse start mesh).
#ifndef TESSERA_COMMON_SYNTH_SYNTH_H_
#define TESSERA_COMMON_SYNTH_SYNTH_H_

#include <array>
#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "common/base/task_control.h"

namespace tessera {

struct SynthOptions {
  int columns = 2, rows = 2;  // blocks, 44 m each
  uint64_t seed = 1;
  double gsd_m = 0.12;  // ground sampling distance of the nadir images
  int image_width_px = 1000, image_height_px = 750;
  bool with_images = true;  // false: meshes, cameras and truth mesh only
  bool overwrite = false;   // take the place of what an earlier call left in the folder
};

// What was made, and how hard it is. The three accuracies are measured, not chosen: how hard a scene is, is the same
// for every seed and size within the ranges that label_noise.h names.
struct SynthReport {
  int64_t images = 0, sparse_points = 0, truth_faces = 0, start_faces = 0;
  double area_m2 = 0, gsd_m = 0, voxel_m = 0;
  std::array<int64_t, 5> changes{};     // of a later epoch: built, demolished, grown, felled, label
  double start_accuracy_by_area = 0;    // mean recall over classes, start faces against the nearest true surface
  double start_accuracy_by_pixels = 0;  // mean recall over classes, the start mesh rendered against the true labels
  double likelihood_accuracy = 0;       // share of pixels whose likeliest class is the true one
};

// Writes the scene into `folder` in the layout that scene.json defines, with truth/ and synth.json; scene.json comes
// last, so a folder that has one is complete. Same options, same bytes, for any number of threads. Memory is bounded by
// a part of the city, plus 8 bytes a start vertex. INVALID_ARGUMENT for senseless options, FAILED_PRECONDITION if the
// folder is not empty and `overwrite` is false, CANCELLED.
StatusOr<SynthReport> SynthesizeCity(const SynthOptions& options, const std::string& folder,
                                     const TaskControl& control);

// A later epoch of a city.
struct SecondEpochOptions {
  std::string base_folder;                            // the city, as SynthesizeCity left it
  std::array<double, 4> part = {0.3, 0.3, 0.7, 0.7};  // x, y, x, y as shares of the city's extent
  uint64_t seed = 1;                                  // of the changes and of the flight's drift
  bool changes = true;                                // false: the city stays as it was; only the flight is another
  bool whole = false;     // the complete scene: the city's images and start mesh too, the same bytes
  bool new_mesh = false;  // the complete scene with a start mesh of the changed city
  bool overwrite = false;
};

// Writes the same city one year later: some of what stands inside the part has changed (changes.h), and a new flight
// sees the part alone. The scene holds the new images alone and no start mesh, unless the options say otherwise; its
// truth/ is that of the changed city, with changes.geojson. Otherwise as SynthesizeCity. INVALID_ARGUMENT also names
// what is wrong in the base folder, and a part with no room for a change.
StatusOr<SynthReport> SynthesizeSecondEpoch(const SecondEpochOptions& options, const std::string& folder,
                                            const TaskControl& control);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_SYNTH_H_
