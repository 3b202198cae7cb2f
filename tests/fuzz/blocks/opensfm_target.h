// Reconstructions of OpenSfM with the files beside them, a frame each.
#pragma once

#include <string>

#include "common/blocks/opensfm/opensfm.h"
#include "tests/fuzz/frames.h"
#include "tests/fuzz/blocks/block_promises.h"

namespace tessera {

// The kind of a frame is the file: reconstructions, tracks, reference, shots, coords, model_geo, proj; 7 and 8 stand
// for the flags `projected` and `topocentric`.
inline bool RunOpenSfmTarget(const std::string& bytes) {
  const std::vector<InputFrame> frames = SplitFrames(bytes);
  OpenSfmFiles files;
  std::string_view* const texts[] = {&files.reconstructions, &files.tracks,    &files.reference_lla, &files.shots,
                                     &files.coords,          &files.model_geo, &files.proj};
  for (const InputFrame& frame : frames) {
    if (frame.kind < std::size(texts)) *texts[frame.kind] = frame.bytes;
    if (frame.kind == 7) files.projected = true;
    if (frame.kind == 8) files.topocentric = true;
  }
  Faults faults;
  Warnings warnings;
  const ImportedBlock block = ParseOpenSfm(files, {}, &faults, &warnings);
  if (!Accepted(faults)) return false;
  RequireBlock(block);
  return true;
}

}  // namespace tessera
