// Writing of a synthetic scene's text files: COLMAP model, scene.json, synth.json.
#pragma once

#include <string>
#include <vector>

#include "common/synth/city/base_city.h"
#include "common/synth/city/epoch_changes.h"
#include "common/synth/photos/flight.h"
#include "common/synth/photos/sparse_points.h"
#include "common/synth/synth.h"

namespace tessera {

// Writes cameras.txt, images.txt and points3D.txt in `folder`. The views of `flight` get ids from 1 in order. With an
// `earlier` model of the same cameras, its text comes first and the new ids follow its ids.
Status WriteColmapText(const std::string& folder, const std::vector<SynthView>& flight, const std::string& extension,
                       const std::vector<SparsePoint>& points, const ColmapText* earlier = nullptr);

// Options and changes of a second epoch, for its files.
struct EpochFiles {
  const SecondEpochOptions& options;
  const std::vector<CityChange>& changes;
};

// Name of the second epoch's flight; the names of its images begin with it and '_'.
inline constexpr char kLaterFlight[] = "next";

// Writes synth.json, then scene.json. `epoch`: null for the first epoch.
Status WriteSceneJson(const std::string& folder, const std::string& name, const SynthOptions& options,
                      const SynthReport& report, const EpochFiles* epoch = nullptr);

}  // namespace tessera
