// How the likelihood files of a scene are read where a file alone does not decide it.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

struct LikelihoodForm {
  enum class Layout { kByShape, kClassesFirst, kClassesLast };  // of arrays with three axes
  enum class Values { kUnstated, kProbabilities, kLogits };     // unstated: as probabilities
  Layout layout = Layout::kByShape;
  Values values = Values::kUnstated;
  std::optional<int> first_id;  // id of class 0 in files of ids: 0 (default), or 1; then 0 is unknown
  // Colours (RGB) of the classes, in order. Not empty: they decide in files with colours or a palette. Empty: the
  // indices of a palette are ids.
  std::vector<std::array<uint8_t, 3>> colors;
  bool operator==(const LikelihoodForm&) const = default;
};

// Completes `given`, the form that scene.json states, by the content of all label files (PNG, arrays of ids) among the
// likelihood files at `paths`. `colors`: of the classes. What is unusual is added to `warnings`. Files that cannot be
// read are skipped: reading their likelihoods gives the error.
LikelihoodForm FindLikelihoodForm(const std::vector<std::string>& paths,
                                  const std::vector<std::array<uint8_t, 3>>& colors, const LikelihoodForm& given,
                                  Warnings* warnings);

}  // namespace tessera
