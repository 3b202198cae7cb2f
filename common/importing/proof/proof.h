// Proof of a block on its own tie points: whether poses, lenses and image coordinates were read as the program that
// wrote them defines them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/blocks/block.h"
#include "common/importing/proof/residuals.h"

namespace tessera {

struct ProofOptions {
  double max_error_px = 1.5;  // the largest median residual that is accepted
  bool alternatives = true;   // whether conventions that the format does not have are tried
  int64_t sampled = 20'000;   // observations that readings and alternatives are compared on
};

struct ProofRow {
  std::string name;
  ResidualSummary residuals;
};

// A convention other than the one that was read.
struct ProofAlternative {
  std::string name;           // "transposed rotations and P1 and P2 swapped"
  ResidualSummary residuals;  // of the sample
  bool is_better = false;     // its median is lower by a tenth, and by more than noise
  bool is_applied = false;    // of ImportedBlock::readings
};

struct Proof {
  ResidualSummary tie_points, control_points;
  ResidualSummary sample;  // as read, with the applied readings; of tie points, and of control points if those are few
  std::vector<ProofRow> cameras;               // with observations of tie points, in the block's order
  std::vector<ProofRow> images;                // the same, by path
  std::vector<int> bad_images;                 // indices into `images`: the median is over three times that of all
  std::vector<ProofAlternative> readings;      // of the format: ImportedBlock::readings
  std::vector<ProofAlternative> alternatives;  // the best ones first
  int64_t triangulated = 0;                    // tie points that had no position
  int64_t not_triangulated = 0;                // and whose images do not intersect
  // Enough observations, and their median is at most ProofOptions::max_error_px.
  bool is_proven = false;
};

// Measures the residuals of tie points and control points. First applies to `block` those of its readings that fit the
// tie points better (ImportedBlock::conventions gets a sentence each). The block's coordinates must be Cartesian, as
// for ResidualsOf. Tie points without a position get one; those that cannot be triangulated are removed if the block is
// proven (ImportedBlock::left_out).
Proof MeasureProof(ImportedBlock* block, const ProofOptions& options);

// INVALID_ARGUMENT if the median residual is above options.max_error_px, with those of the best alternatives. Adds
// warnings: images with bad residuals, alternatives that fit better, control points that do not fit. OK without tie
// points and control points.
Status JudgeProof(const ImportedBlock& block, const Proof& proof, const ProofOptions& options, Warnings* warnings);

// MeasureProof and JudgeProof. Without observations, or with few, the result is not proven.
StatusOr<Proof> ProveByTiePoints(ImportedBlock* block, const ProofOptions& options, Warnings* warnings);

// "0.263 px"; "infinity (points behind the cameras)".
std::string ResidualText(double residual_px);

// A table under a header: all points, each camera, the `most_rows` worst images, readings and alternatives.
std::string ProofToText(const Proof& proof, size_t most_rows);

// An object for import.json; units are in the keys. Infinite residuals are null.
std::string ProofToJson(const Proof& proof);

}  // namespace tessera
