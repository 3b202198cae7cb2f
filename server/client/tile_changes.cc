#include "server/client/tile_changes.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/str_cat.h"
#include "common/job/task_parameters.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

using Json = nlohmann::ordered_json;

bool IsTileMesh(const std::string& name) {
  return name.starts_with(absl::StrCat(kTileMeshFolder, "/")) && name.ends_with(".ply");
}

Json Sha256OrNull(const std::string& sha256) { return sha256.empty() ? Json(nullptr) : Json(sha256); }

}  // namespace

std::vector<TileFileChange> CompareTileFiles(const v1::Job& base, const v1::Job& job) {
  std::map<std::string, TileFileChange> by_name;
  const auto take = [&](const v1::Job& from, std::string TileFileChange::*sha256) {
    for (const v1::Artifact& artifact : from.artifacts()) {
      if (!IsTileMesh(artifact.name())) continue;
      TileFileChange& change = by_name[artifact.name()];
      change.name = artifact.name();
      change.*sha256 = artifact.digest().sha256();
    }
  };
  take(base, &TileFileChange::old_sha256);
  take(job, &TileFileChange::new_sha256);
  std::vector<TileFileChange> changes;
  for (auto& [name, change] : by_name) changes.push_back(std::move(change));
  return changes;
}

v1::Job OnlyChanged(const v1::Job& job, const std::vector<TileFileChange>& changes) {
  std::set<std::string> changed;
  for (const TileFileChange& change : changes) {
    if (change.changed()) changed.insert(change.name);
  }
  v1::Job wanted = job;
  wanted.clear_artifacts();
  for (const v1::Artifact& artifact : job.artifacts()) {
    if (artifact.name().ends_with(".json") || changed.contains(artifact.name())) *wanted.add_artifacts() = artifact;
  }
  return wanted;
}

std::string ChangesJson(const v1::Job& base, const v1::Job& job, const std::vector<TileFileChange>& changes) {
  Json tiles = Json::array();
  for (const TileFileChange& change : changes) {
    tiles.push_back({{"name", change.name},
                     {"old_sha256", Sha256OrNull(change.old_sha256)},
                     {"new_sha256", Sha256OrNull(change.new_sha256)},
                     {"changed", change.changed()}});
  }
  const auto count = std::count_if(changes.begin(), changes.end(), [](const auto& change) { return change.changed(); });
  const Json json = {{"tessera_changes", 1},
                     {"job", job.name()},
                     {"base", base.name()},
                     {"changed", count},
                     {"tiles", std::move(tiles)}};
  return json.dump(1) + "\n";
}

}  // namespace tessera
