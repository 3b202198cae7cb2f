// Simulated photographs of the city with typical image errors, and the true class and position of each pixel.
#pragma once

#include "common/imaging/raster.h"
#include "common/synth/city/city_scene.h"
#include "common/synth/photos/flight.h"

namespace tessera {

struct RenderedView {
  ByteImage rgb;        // empty if not requested
  LabelImage labels;    // class at pixel centres; 255: no surface
  FloatImage position;  // world x, y, z in metres of the surface at pixel centres; undefined where labels are 255
};

// Renders with four rays per pixel (its centre and three around it), sun and sky light and gamma 2.2, then applies
// vignetting, a random exposure and sensor noise from `seed`. Runs in parallel; the result does not depend on the
// number of threads.
RenderedView RenderView(const CityScene& scene, const SynthView& view, uint64_t seed, bool with_rgb);

}  // namespace tessera
