// The text files of a synthetic scene: COLMAP's model, scene.json, synth.json.
#ifndef TESSERA_COMMON_SYNTH_SCENE_FILES_H_
#define TESSERA_COMMON_SYNTH_SCENE_FILES_H_

#include <string>
#include <vector>

#include "common/synth/flight.h"
#include "common/synth/sparse_points.h"
#include "common/synth/synth.h"

namespace tessera {

// cameras.txt, images.txt and points3D.txt in `folder`. Views named in `flight` get ids from 1 in their order.
Status WriteColmapText(const std::string& folder, const std::vector<SynthView>& flight, const std::string& extension,
                       const std::vector<SparsePoint>& points);

// synth.json, then scene.json.
Status WriteSceneJson(const std::string& folder, const std::string& name, const SynthOptions& options,
                      const SynthReport& report);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_SCENE_FILES_H_
