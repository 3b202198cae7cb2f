// Proof of an imported scene on its photographs, for blocks without tie points: patches of pairs of images, warped
// through the mesh. Only offsets across the epipolar lines count, because a coarse mesh moves patches along them.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/check/fit.h"

namespace tessera {

struct PatchProof {
  int pairs = 0;                     // of images, with enough patches
  int measured = 0;                  // those with enough distinct matches for a median
  int good = 0;                      // those with a median offset of at most kGoodPair_px across the epipolar lines
  double median_px = 0, p90_px = 0;  // of the medians of the measured pairs
  // At least 90 % of the measured pairs are good, and enough are measured.
  bool is_proven = false;
};

inline constexpr double kGoodPair_px = 0.5;

// `fit`: of the written scene (MeasureFit, SceneSummary::fit).
PatchProof ProveByPatches(const SceneFit& fit);

// INVALID_ARGUMENT if the pairs are off by more than `max_error_px` in the median. Adds a warning if they are measured
// but not proven. `file`: of the block, for messages.
Status JudgePatchProof(const std::string& file, const PatchProof& proof, double max_error_px, Warnings* warnings);

// "proven: 38 of 40 pairs of images ...", or "not proven: ..."
std::string PatchProofToText(const PatchProof& proof);

// An object for import.json; units are in the keys.
std::string PatchProofToJson(const PatchProof& proof);

}  // namespace tessera
