// COLMAP sparse models, text and binary: https://colmap.github.io/format.html
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/colmap/calibrated_images.h"
#include "common/storage/allowed_files.h"

namespace tessera {

// Reads the model in `folder`: cameras.* and images.*, and points3D.* if it exists and is requested. Camera models:
// SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, and in text TESSERA_BROWN (LensModel::kBrown); a
// camera with only zero coefficients becomes a pinhole. Quaternions are normalised. Invalid entries are omitted and
// reported to `faults` with file and line (text) or byte offset (binary); those of cameras only if an image has the
// camera. Allocates at most a small multiple of the files' sizes.
// - Of a text and a binary model, the binary one is read; if they differ by more than rounding, the newer one, with a
//   warning.
// - A folder without a model may have models in 0, 1, ..., sparse, sparse/0, sparse/1, ...: that with most images is
//   read, with a warning.
// - If there are frames.* and rigs.* (COLMAP 3.12), poses of images that differ from theirs are a fault.
// Warnings begin with `folder`; `warnings` may be null.
CalibratedImages ReadColmapModel(const std::string& folder, CalibrationContent content, Faults* faults,
                                 const AllowedFiles& allowed = AllowedFiles::All(), Warnings* warnings = nullptr);

// The same from the contents of the three files, for tests and fuzzing. `folder` is the path in messages. Entries are
// added to `model`.
void ParseColmapText(const std::string& cameras, const std::string& images, const std::string& points,
                     const std::string& folder, CalibrationContent content, CalibratedImages* model, Faults* faults);
void ParseColmapBinary(const std::string& cameras, const std::string& images, const std::string& points,
                       const std::string& folder, CalibrationContent content, CalibratedImages* model, Faults* faults);

}  // namespace tessera
