// The city that a later epoch is made from, as its folder tells.
#ifndef TESSERA_COMMON_SYNTH_BASE_CITY_H_
#define TESSERA_COMMON_SYNTH_BASE_CITY_H_

#include <string>

#include "common/base/status.h"
#include "common/synth/synth.h"

namespace tessera {

struct BaseCity {
  SynthOptions options;
  SynthReport report;  // of its start mesh; the rest is zero
};

// Reads synth.json in `folder`. INVALID_ARGUMENT names the file if it is no city of `tessera synth`, has no images, or
// is a later epoch itself.
StatusOr<BaseCity> ReadBaseCity(const std::string& folder);

// Gives a file a second name, or copies it where the file system cannot.
Status LinkFile(const std::string& from, const std::string& to);
// The same with each file under the folder `from`.
Status LinkFiles(const std::string& from, const std::string& to);

// What stands in COLMAP's text files of `folder`.
struct ColmapText {
  std::string cameras, images, points;
  int image_count = 0;
  int64_t point_count = 0;
};
StatusOr<ColmapText> ReadColmapText(const std::string& folder);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_BASE_CITY_H_
