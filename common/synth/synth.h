// `tessera synth`: generates a procedural city with ground truth as a scene (images, cameras, likelihoods, coarse start
// mesh).
#pragma once

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
  bool with_images = true;  // false: only meshes, cameras and truth mesh
  bool overwrite = false;   // replace an existing synthetic scene in the folder
};

// Statistics of the scene and its difficulty. The three accuracies are measured; for all seeds and sizes they lie in
// the ranges of label_noise.h.
struct SynthReport {
  int64_t images = 0, sparse_points = 0, truth_faces = 0, start_faces = 0;
  double area_m2 = 0, gsd_m = 0, voxel_m = 0;
  std::array<int64_t, 5> changes{};     // second epoch: built, demolished, grown, felled, label
  double start_accuracy_by_area = 0;    // mean recall over classes: start faces against the nearest true surface
  double start_accuracy_by_pixels = 0;  // mean recall over classes: rendered start mesh against the true labels
  double likelihood_accuracy = 0;       // share of pixels whose likeliest class is the true one
};

// Writes the scene into `folder`, with truth/ and synth.json. scene.json is written last, so a folder with scene.json
// is complete. The result depends only on the options, not on the number of threads. Memory is bounded by a part of the
// city plus 8 bytes per start vertex. INVALID_ARGUMENT for invalid options, FAILED_PRECONDITION if the folder is not
// empty and `overwrite` is false, CANCELLED.
StatusOr<SynthReport> SynthesizeCity(const SynthOptions& options, const std::string& folder,
                                     const TaskControl& control);

// Options of a second epoch of a city.
struct SecondEpochOptions {
  std::string base_folder;                            // output folder of SynthesizeCity
  std::array<double, 4> part = {0.3, 0.3, 0.7, 0.7};  // changed area: x0, y0, x1, y1 relative to the city's extent
  uint64_t seed = 1;                                  // for the changes and the flight's drift
  bool changes = true;                                // false: an unchanged city with a new flight
  bool whole = false;     // a complete scene that includes the base city's images and start mesh
  bool new_mesh = false;  // a complete scene with a start mesh of the changed city
  bool overwrite = false;
};

// Writes a second epoch of the city: objects inside the part have changed (changes.h), and a new flight covers the
// part. By default the scene contains only the new images and no start mesh. truth/ is that of the changed city, with
// changes.geojson. Otherwise like SynthesizeCity. Also INVALID_ARGUMENT for an invalid base folder, and for a part
// without room for a change.
StatusOr<SynthReport> SynthesizeSecondEpoch(const SecondEpochOptions& options, const std::string& folder,
                                            const TaskControl& control);

}  // namespace tessera
