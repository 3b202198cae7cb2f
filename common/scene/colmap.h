// COLMAP sparse models, text and binary: https://colmap.github.io/format.html
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/scene/calibrated_images.h"
#include "common/storage/allowed_files.h"

namespace tessera {

// Reads the model in `folder`: cameras.bin and images.bin, else cameras.txt and images.txt, and points3D.* if it exists
// and is requested. Camera models: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV; a camera with
// only zero coefficients becomes a pinhole. Quaternions are normalised. Invalid entries are omitted and reported to
// `faults` with file and line (text) or byte offset (binary). Allocates at most a small multiple of the files' sizes.
CalibratedImages ReadColmapModel(const std::string& folder, CalibrationContent content, Faults* faults,
                                 const AllowedFiles& allowed = AllowedFiles::All());

// The same from the contents of the three files, for tests and fuzzing. `folder` is the path in messages. Entries are
// added to `model`.
void ParseColmapText(const std::string& cameras, const std::string& images, const std::string& points,
                     const std::string& folder, CalibrationContent content, CalibratedImages* model, Faults* faults);
void ParseColmapBinary(const std::string& cameras, const std::string& images, const std::string& points,
                       const std::string& folder, CalibrationContent content, CalibratedImages* model, Faults* faults);

}  // namespace tessera
