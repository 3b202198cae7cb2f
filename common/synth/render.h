// Photographs of the city with the flaws of real ones, and the truth of each pixel.
#ifndef TESSERA_COMMON_SYNTH_RENDER_H_
#define TESSERA_COMMON_SYNTH_RENDER_H_

#include "common/imaging/raster.h"
#include "common/synth/city_scene.h"
#include "common/synth/flight.h"

namespace tessera {

struct RenderedView {
  ByteImage rgb;        // empty if only the truth was asked for
  LabelImage labels;    // at pixel centres; 255: nothing seen
  FloatImage position;  // world x, y, z of what pixel centres see, metres; meaningless where labels are 255
};

// Four rays a pixel (its centre and three around it), sun and sky light, gamma 2.2; then vignetting, an exposure of its
// own and sensor noise drawn from `seed`. Runs in parallel; the same bytes for every number of threads.
RenderedView RenderView(const CityScene& scene, const SynthView& view, uint64_t seed, bool with_rgb);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_RENDER_H_
