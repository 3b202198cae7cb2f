// A trained classifier and its file format.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/classify/boosted_trees.h"

namespace tessera {

// The inputs of a likelihood: colour and texture (kAppearance, for comparison), or also the start mesh (kGeometry,
// which jobs read).
enum class Evidence { kAppearance = 0, kGeometry = 1 };
inline constexpr std::array<const char*, 2> kEvidenceNames = {"appearance", "geometry"};

struct ClassifierPart {
  BoostedTrees trees;
  double temperature = 1;
};

struct ClassifierModel {
  std::vector<std::string> classes;
  std::vector<std::string> features;    // names of all features; appearance features first
  double gsd_m = 0;                     // of the training images
  std::array<ClassifierPart, 2> parts;  // by Evidence
};

inline constexpr int kModelVersion = 1;
inline constexpr int64_t kMaxModelBytes = int64_t{64} << 20;

// Writes the model as an array file (common/arrays). Equal models give equal bytes.
std::string SerializeModel(const ClassifierModel& model);
// Parses and fully validates a model. INVALID_ARGUMENT or DATA_LOSS for damaged files, and for models with features
// that this version does not compute.
StatusOr<ClassifierModel> ParseModel(const std::string& bytes, const std::string& name);

// The index in the model's classes of each of `classes`. INVALID_ARGUMENT if the model lacks one; `name` is the model's
// name in the message.
StatusOr<std::vector<int>> ModelClassesOf(const ClassifierModel& model, const std::vector<std::string>& classes,
                                          const std::string& name);

// A warning if the scene's GSD differs from the model's by more than a factor of 1.5, else empty. `name` is the model's
// name in the message.
std::string GsdWarning(const ClassifierModel& model, double gsd_m, const std::string& name);

StatusOr<ClassifierModel> ReadModel(const std::string& path);

}  // namespace tessera
