// Reading of an existing synthetic city, from which a second epoch is made.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/synth/synth.h"

namespace tessera {

struct BaseCity {
  SynthOptions options;
  SynthReport report;  // only the figures of the start mesh are set
};

// Reads synth.json in `folder`. INVALID_ARGUMENT with the file if it was not written by `tessera synth`, if the city
// has no images, or if it is itself a second epoch.
StatusOr<BaseCity> ReadBaseCity(const std::string& folder);

// Creates a hard link, or copies the file if the file system does not support links.
Status LinkFile(const std::string& from, const std::string& to);
// LinkFile for each file below the folder `from`.
Status LinkFiles(const std::string& from, const std::string& to);

// The contents of COLMAP's text files in a folder.
struct ColmapText {
  std::string cameras, images, points;
  int image_count = 0;
  int64_t point_count = 0;
};
StatusOr<ColmapText> ReadColmapText(const std::string& folder);

}  // namespace tessera
