// The data that an update inherits from its base job, and the names of the base's scene files.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/storage/hash.h"
#include "server/tiling/cost_scale.h"

namespace tessera {

// The data that an update inherits from its base job.
struct UpdateBase {
  std::string name;            // "jobs/J"
  Digest survey, plain, city;  // its kSurveyFile, kPlainSurveyFile and kCityFile
  std::string survey_json;     // content of `survey`
  std::vector<TileParameters> tiles;
  std::vector<Digest> states;            // final state of each tile; Digest() for a removed tile
  Digest mesh;                           // its kMeshFile
  std::vector<int> quarantined;          // tiles of a partial result, ascending
  std::optional<Digest> changes;         // its kChangesGeoJsonFile
  std::optional<Digest> outdated;        // its kOutdatedFile
  std::optional<Digest> borders;         // its kBordersFile, if it computed likelihoods
  bool flip_edges = false;               // it published flipped edges
  std::vector<NamedDigest> scene_files;  // sorted by name
  // Summed over the base and its own bases; ingest (with inspect): the base only.
  MeasuredCosts measured;
  int inspections = 0;  // inspect tasks of the update itself, once they are planned
};

// An update's list of scene files contains its own files and those of its base that its scene lacks. The latter stay in
// the base's scene and get names made of their digests: CarriedName.
std::string CarriedName(const NamedDigest& file_of_base);
bool IsCarried(const std::string& name);
// Whether the file is in the scene's folder. Carried files and kClassifierFile, which is a blob, are not.
bool LiesInScene(const std::string& name);

// The measured correction of the cost model's seconds. `survey`: the base's.
CostScale CostsOf(const UpdateBase& base, const Survey& survey);

}  // namespace tessera
