// Pix4D's text files: camera parameters, and after lines "====" external positions, matrices and tie points.
#pragma once

#include <string>

#include "common/blocks/pix4d/pix4d.h"
#include "common/blocks/pix4d/pix4d_tie_points.h"
#include "tests/fuzz/blocks/block_promises.h"

namespace tessera {

// Parses the files; aborts if what comes out breaks a promise. True if all were taken.
inline bool RunPix4dTarget(const std::string& bytes) {
  std::string files[4];
  size_t at = 0;
  for (std::string& file : files) {
    if (at > bytes.size()) break;
    const size_t end = bytes.find("====\n", at);
    file = bytes.substr(at, end == std::string::npos ? end : end - at);
    at = end == std::string::npos ? bytes.size() + 1 : end + 5;
  }
  ImportedBlock block;
  Faults faults;
  ParsePix4dCameras(files[0], "input", &block, &faults);
  if (!Accepted(faults)) return false;
  RequireBlock(block);
  if (!files[1].empty()) ParsePix4dPositions(files[1], "input", &block, &faults);
  if (!files[2].empty()) ComparePix4dMatrices(files[2], "input", &block, &faults);
  if (!files[3].empty()) ParsePix4dTiePoints(files[3], "input", &block, &faults);
  if (!Accepted(faults)) return false;
  Require(block.offset.allFinite(), "ParsePix4dPositions'");
  RequireBlock(block);
  return true;
}

}  // namespace tessera
