// What an update takes from its base job, and the names of the base's scene files.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/storage/hash.h"
#include "server/tiling/cost_scale.h"

namespace tessera {

// What an update takes from its base job.
struct UpdateBase {
  std::string name;            // "jobs/J"
  Digest survey, plain, city;  // its kSurveyFile, kPlainSurveyFile and kCityFile
  std::string survey_json;     // content of `survey`
  std::vector<TileParameters> tiles;
  std::vector<Digest> states;            // the last of each tile; Digest() of a tile that was removed
  std::optional<Digest> outdated;        // its kOutdatedFile
  std::optional<Digest> borders;         // its kBordersFile, if it made its likelihoods itself
  bool flip_edges = false;               // in what it published
  std::vector<NamedDigest> scene_files;  // those of the base, sorted by name
  // Of the base and of its own bases; of ingest, that of the base alone.
  MeasuredCosts measured;
};

// An update's list of scene files holds those of its own scene and, under names made of their digests, those of its
// base that its own scene lacks. The latter lie in the base's scene.
std::string CarriedName(const NamedDigest& file_of_base);
bool IsCarried(const std::string& name);
// Whether the file lies in the scene's folder: neither carried nor kClassifierFile, which is a blob.
bool LiesInScene(const std::string& name);

// The measured correction of the cost model's seconds. `survey`: the base's.
CostScale CostsOf(const UpdateBase& base, const Survey& survey);

}  // namespace tessera
