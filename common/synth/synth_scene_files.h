// The text files of a synthetic scene: COLMAP's model, scene.json, synth.json.
#ifndef TESSERA_COMMON_SYNTH_SYNTH_SCENE_FILES_H_
#define TESSERA_COMMON_SYNTH_SYNTH_SCENE_FILES_H_

#include <string>
#include <vector>

#include "common/synth/base_city.h"
#include "common/synth/epoch_changes.h"
#include "common/synth/flight.h"
#include "common/synth/sparse_points.h"
#include "common/synth/synth.h"

namespace tessera {

// cameras.txt, images.txt and points3D.txt in `folder`. Views named in `flight` get ids from 1 in their order; where
// there is an `earlier` model of the same cameras, all ids follow its ids and its text comes first.
Status WriteColmapText(const std::string& folder, const std::vector<SynthView>& flight, const std::string& extension,
                       const std::vector<SparsePoint>& points, const ColmapText* earlier = nullptr);

// What a later epoch's scene is, beside what the city's options say.
struct EpochFiles {
  const SecondEpochOptions& options;
  const std::vector<CityChange>& changes;
};

// The later epoch's flight; the names of its images begin with it and '_'.
inline constexpr char kLaterFlight[] = "next";

// synth.json, then scene.json. `epoch`: null for a city's first.
Status WriteSceneJson(const std::string& folder, const std::string& name, const SynthOptions& options,
                      const SynthReport& report, const EpochFiles* epoch = nullptr);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_SYNTH_SCENE_FILES_H_
