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

// What a likelihood file holds that decides the form of all files.
struct LabelContent {
  enum class Kind { kNoLabels, kIds, kPalette, kColors };
  Kind kind = Kind::kNoLabels;
  bool has_class_colors = false;  // all colours are those of classes or black, at least one is a class's
  bool has_ids = false;           // all values can be ids
  int64_t highest_id = -1;        // without 255
  int64_t zeros = 0, pixels = 0;  // pixels with id 0, and with any id
  bool operator==(const LabelContent&) const = default;
};

// Of a label file (PNG, array of ids); kNoLabels of other files, and of one that cannot be read. `colors`: of the
// classes.
LabelContent ReadLabelContent(const std::string& path, const std::vector<std::array<uint8_t, 3>>& colors);

// Completes `given`, the form that scene.json states, by the content of all label files among the likelihood files at
// `paths`. `contents`: of each of them. `colors`: of the classes. What is unusual is added to `warnings`.
LikelihoodForm CompleteLikelihoodForm(const std::vector<std::string>& paths, const std::vector<LabelContent>& contents,
                                      const std::vector<std::array<uint8_t, 3>>& colors, const LikelihoodForm& given,
                                      Warnings* warnings);

// The same, after reading the files. Those that cannot be read are skipped: reading their likelihoods gives the error.
LikelihoodForm FindLikelihoodForm(const std::vector<std::string>& paths,
                                  const std::vector<std::array<uint8_t, 3>>& colors, const LikelihoodForm& given,
                                  Warnings* warnings);

}  // namespace tessera
