#include "common/importing/proof/patch_proof.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera {
namespace {

constexpr int kLeastPairs = 5;          // fewer prove nothing
constexpr double kGoodPairShare = 0.9;  // of the measured ones
constexpr double kMeasuredShare = 0.5;  // of all pairs; in the others, too few patches match

}  // namespace

PatchProof ProveByPatches(const SceneFit& fit) {
  PatchProof proof;
  std::vector<double> across_px;
  for (const FitPairShare& pair : fit.pairs) {
    ++proof.pairs;
    if (pair.share.across_px < 0) continue;
    across_px.push_back(pair.share.across_px);
    proof.good += pair.share.across_px <= kGoodPair_px;
  }
  proof.measured = static_cast<int>(across_px.size());
  if (across_px.empty()) return proof;
  std::sort(across_px.begin(), across_px.end());
  proof.median_px = across_px[(across_px.size() - 1) / 2];
  proof.p90_px = across_px[(across_px.size() - 1) * 9 / 10];
  proof.is_proven = proof.measured >= kLeastPairs && proof.measured >= kMeasuredShare * proof.pairs &&
                    proof.good >= kGoodPairShare * proof.measured;
  return proof;
}

Status JudgePatchProof(const std::string& file, const PatchProof& proof, double max_error_px, Warnings* warnings) {
  if (proof.measured >= kLeastPairs && proof.median_px > max_error_px) {
    return InputError(
        file, "poses",
        absl::StrFormat("patches of images that are %.2f px off across the epipolar lines in the median of %d pairs",
                        proof.median_px, proof.measured),
        absl::StrFormat("at most %g px (--max-error-px): lenses and poses that fit the photographs", max_error_px));
  }
  if (proof.measured > 0 && !proof.is_proven) warnings->push_back(absl::StrCat(file, ": ", PatchProofToText(proof)));
  return absl::OkStatus();
}

std::string PatchProofToText(const PatchProof& proof) {
  if (proof.measured == 0) return "not proven: no pairs of images with patches that match";
  return absl::StrFormat(
      "%s: %d of %d pairs of images (%d have too few matches) fit within %g px across the epipolar lines, expected "
      "%.0f "
      "%%; median %.2f px, 90 %% %.2f px",
      proof.is_proven ? "proven" : "not proven", proof.good, proof.measured, proof.pairs - proof.measured, kGoodPair_px,
      100 * kGoodPairShare, proof.median_px, proof.p90_px);
}

std::string PatchProofToJson(const PatchProof& proof) {
  return nlohmann::ordered_json{{"proven", proof.is_proven},           {"pairs", proof.pairs},
                                {"measured_pairs", proof.measured},    {"good_pairs", proof.good},
                                {"across_median_px", proof.median_px}, {"across_p90_px", proof.p90_px}}
      .dump(2);
}

}  // namespace tessera
