// A trained classifier, and the file that carries it to the next flight or city.
#ifndef TESSERA_COMMON_CLASSIFY_MODEL_H_
#define TESSERA_COMMON_CLASSIFY_MODEL_H_

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/classify/boosted_trees.h"

namespace tessera {

// What a likelihood rests on: colour and texture alone, for shape; or the start mesh too, for labels.
enum class Evidence { kAppearance = 0, kGeometry = 1 };
inline constexpr std::array<const char*, 2> kEvidenceNames = {"appearance", "geometry"};

struct ClassifierPart {
  BoostedTrees trees;
  double temperature = 1;
};

// A plain value.
struct ClassifierModel {
  std::vector<std::string> classes;
  std::vector<std::string> features;    // all; those of appearance first
  double gsd_m = 0;                     // of the images that it learnt from
  std::array<ClassifierPart, 2> parts;  // by Evidence
};

inline constexpr int kModelVersion = 1;
inline constexpr int64_t kMostModelBytes = int64_t{64} << 20;

// An array file (common/tile) with a checksum for each part; the same model is the same bytes.
std::string SerializeModel(const ClassifierModel& model);
// Whatever the bytes: INVALID_ARGUMENT or DATA_LOSS with what was found, or a model that can be used as it is with this
// version's features.
StatusOr<ClassifierModel> ParseModel(const std::string& bytes, const std::string& name);

// Of the model's classes, that of each of `classes`. INVALID_ARGUMENT if it lacks one; `name` stands for the model.
StatusOr<std::vector<int>> ModelClassesOf(const ClassifierModel& model, const std::vector<std::string>& classes,
                                          const std::string& name);

// What to warn of where a model meets a scene of another resolution; empty: nothing. `name` stands for the model.
std::string GsdWarning(const ClassifierModel& model, double gsd_m, const std::string& name);

Status WriteModel(const std::string& path, const ClassifierModel& model);
StatusOr<ClassifierModel> ReadModel(const std::string& path);

}  // namespace tessera

#endif  // TESSERA_COMMON_CLASSIFY_MODEL_H_
