// A row of blocks with small images, for tests with several tiles.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "common/synth/synth.h"

namespace tessera {

// Writes the scene to `folder`; fails the test on errors.
inline void SynthesizeStrip(const std::string& folder, int columns) {
  SynthOptions options;
  options.columns = columns;
  options.rows = 1;
  options.gsd_m = 0.5;
  options.image_width_px = 120;
  options.image_height_px = 90;
  const auto made = SynthesizeCity(options, folder, TaskControl());
  ASSERT_TRUE(made.ok()) << made.status();
}

}  // namespace tessera
