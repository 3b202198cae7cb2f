#include "common/classify/model.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "common/arrays/array_file.h"
#include "common/base/json_bounds.h"
#include "common/classify/features.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

using Json = nlohmann::json;

constexpr double kMaxGsdRatio = 1.5;  // accepted ratio of the scene's and the model's GSD, in either direction
constexpr const char* kKind = "tessera classifier";

Status ParseMetadata(const std::string& text, const std::string& name, ClassifierModel* model) {
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(name, text));
  try {
    const Json json = Json::parse(text);
    if (json.value("kind", "") != kKind)
      return InputError(name, "", "an array file of another kind", "a classifier model");
    if (json.at("version") != kModelVersion) {
      return InputError(name, "version", json.at("version").dump(),
                        absl::StrCat(kModelVersion, ": train the model again"));
    }
    model->classes = json.at("classes").get<std::vector<std::string>>();
    model->features = json.at("features").get<std::vector<std::string>>();
    model->gsd_m = json.at("gsd_m").get<double>();
    for (size_t e = 0; e < model->parts.size(); ++e) {
      const Json& part = json.at(kEvidenceNames[e]);
      model->parts[e].temperature = part.at("temperature").get<double>();
      model->parts[e].trees.depth = part.at("depth").get<int>();
    }
  } catch (const Json::exception& error) {
    return InputError(name, "metadata", error.what(), "the metadata of a classifier model");
  }
  return absl::OkStatus();
}

}  // namespace

std::string SerializeModel(const ClassifierModel& model) {
  Json json = {{"kind", kKind},
               {"version", kModelVersion},
               {"classes", model.classes},
               {"features", model.features},
               {"gsd_m", model.gsd_m}};
  ArrayFile file;
  for (size_t e = 0; e < model.parts.size(); ++e) {
    const std::string name = kEvidenceNames[e];
    const BoostedTrees& trees = model.parts[e].trees;
    json[name] = {{"temperature", model.parts[e].temperature}, {"depth", trees.depth}};
    file.arrays[name + ".base"] = trees.base;
    file.arrays[name + ".features"] = trees.features;
    file.arrays[name + ".thresholds"] = trees.thresholds;
    file.arrays[name + ".leaves"] = trees.leaves;
  }
  file.metadata = json.dump();
  return SerializeArrayFile(file);
}

StatusOr<ClassifierModel> ParseModel(const std::string& bytes, const std::string& name) {
  TESSERA_ASSIGN_OR_RETURN(ArrayFile file, ParseArrayFile(bytes, name));
  ClassifierModel model;
  TESSERA_RETURN_IF_ERROR(ParseMetadata(file.metadata, name, &model));
  if (model.classes.size() < 2 || model.classes.size() > 254) {
    return InputError(name, "classes", absl::StrCat(model.classes.size()), "2 to 254");
  }
  if (model.features != FeatureNames()) {
    return InputError(name, "features", absl::StrCat(model.features.size(), " features of another version of Tessera"),
                      absl::StrCat("the ", FeatureCount(), " features of this version: train the model again"));
  }
  if (!(model.gsd_m > 0 && model.gsd_m < 1e6)) {
    return InputError(name, "gsd_m", absl::StrCat(model.gsd_m), "a positive length");
  }
  for (size_t e = 0; e < model.parts.size(); ++e) {
    const std::string part = kEvidenceNames[e];
    BoostedTrees& trees = model.parts[e].trees;
    trees.classes = static_cast<int>(model.classes.size());
    trees.feature_count = static_cast<Evidence>(e) == Evidence::kAppearance ? AppearanceFeatureCount() : FeatureCount();
    TESSERA_ASSIGN_OR_RETURN(trees.base, file.Take<float>(part + ".base"));
    TESSERA_ASSIGN_OR_RETURN(trees.features, file.Take<int32_t>(part + ".features"));
    TESSERA_ASSIGN_OR_RETURN(trees.thresholds, file.Take<float>(part + ".thresholds"));
    TESSERA_ASSIGN_OR_RETURN(trees.leaves, file.Take<float>(part + ".leaves"));
    TESSERA_RETURN_IF_ERROR(trees.Check(absl::StrCat(name, ": ", part)));
    const double temperature = model.parts[e].temperature;
    if (!(temperature >= 0.01 && temperature <= 100)) {
      return InputError(name, part + ".temperature", absl::StrCat(temperature), "a number from 0.01 to 100");
    }
  }
  return model;
}

StatusOr<std::vector<int>> ModelClassesOf(const ClassifierModel& model, const std::vector<std::string>& classes,
                                          const std::string& name) {
  std::vector<int> found;
  for (const std::string& c : classes) {
    const auto it = std::find(model.classes.begin(), model.classes.end(), c);
    if (it == model.classes.end()) {
      return InputError(
          name, "classes", absl::StrJoin(model.classes, ", "),
          absl::StrCat("the scene's class ", c, " too: rename the scene's classes, or train a model with them"));
    }
    found.push_back(static_cast<int>(it - model.classes.begin()));
  }
  return found;
}

std::string GsdWarning(const ClassifierModel& model, double gsd_m, const std::string& name) {
  const double ratio = gsd_m / model.gsd_m;
  if (ratio <= kMaxGsdRatio && ratio >= 1 / kMaxGsdRatio) return "";
  return absl::StrCat(name, ": the model was trained at a GSD of ", model.gsd_m, " m, but the scene's GSD is ", gsd_m,
                      " m, so textures differ: annotate a few images of the scene and train a model");
}

StatusOr<ClassifierModel> ReadModel(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxModelBytes));
  return ParseModel(bytes, path);
}

}  // namespace tessera
