#include "server/plan/rollback.h"

#include <algorithm>
#include <iterator>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "server/tiling/cell_index.h"

namespace tessera {
namespace {

// Per tile: largest distance of a corner of its faces from its core.
std::vector<double> Reaches(const std::vector<TileParameters>& tiles, const Survey& survey) {
  const CellIndex cells(survey);
  std::vector<double> reaches_m;
  for (const TileParameters& tile : tiles) {
    double& reach_m = reaches_m.emplace_back(0);
    cells.ForEachWithin(tile.core, 0, [&](const SurveyCell& cell) { reach_m = std::max(reach_m, cell.reach_m); });
  }
  return reaches_m;
}

bool MadeTogether(const std::vector<UpdateBase>& chain, size_t a, size_t b) {
  for (size_t i = 0; i + 1 < chain.size(); ++i) {
    const std::vector<Digest>&now = chain[i].states, &before = chain[i + 1].states;
    if (!(now[a] == before[a]) && !(now[b] == before[b])) return true;
  }
  return false;
}

}  // namespace

StatusOr<std::vector<int>> TilesToRollBack(const std::vector<UpdateBase>& chain, const Survey& survey,
                                           const std::vector<int>& named) {
  const UpdateBase &job = chain.front(), &earlier = chain.back();
  for (const UpdateBase& each : chain) {
    if (each.city == job.city) continue;
    return absl::InvalidArgumentError(absl::StrCat("mesh: found different meshes in ", each.name, " and ", job.name,
                                                   ", expected the same: their tiles cannot be combined"));
  }
  const int tiles = static_cast<int>(job.tiles.size());
  std::set<int> differ, chosen;
  for (int t = 0; t < tiles; ++t) {
    if (!(job.states[t] == earlier.states[t])) differ.insert(t);
  }
  for (const int tile : named) {
    if (tile < 0 || tile >= tiles) {
      return absl::InvalidArgumentError(absl::StrCat("tile: found ", tile, ", expected one of the ", tiles,
                                                     " tiles of ", job.name, ", numbered from 0"));
    }
    if (differ.contains(tile)) chosen.insert(tile);
  }
  if (named.empty()) chosen = differ;
  if (chosen.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("found no tile to roll back: ", named.empty() ? "all are" : "those named are", " the same in ",
                     job.name, " and ", earlier.name));
  }
  const std::vector<double> reaches_m = Reaches(job.tiles, survey);
  std::set<int> all = chosen;
  for (std::vector<int> open(chosen.begin(), chosen.end()); !open.empty();) {
    const int tile = open.back();
    open.pop_back();
    for (const int other : differ) {
      const double apart_m = DistanceBetween(job.tiles[tile].core, job.tiles[other].core, survey.ground.cell_m);
      if (apart_m > reaches_m[tile] + reaches_m[other] || !MadeTogether(chain, tile, other)) continue;
      if (all.insert(other).second) open.push_back(other);
    }
  }
  if (all.size() == chosen.size()) return std::vector<int>(chosen.begin(), chosen.end());
  std::vector<int> missing;
  std::set_difference(all.begin(), all.end(), chosen.begin(), chosen.end(), std::back_inserter(missing));
  return absl::InvalidArgumentError(
      absl::StrCat(missing.size() == 1 ? "tile " : "tiles ", absl::StrJoin(missing, ", "),
                   " must be restored too: they share vertices with the given tiles and were "
                   "refined by the same job; restore all of them:\n  tessera "
                   "rollback ",
                   job.name, " --to ", earlier.name, " --tile ", absl::StrJoin(all, " --tile ")));
}

PlannedTask BaseTask(const UpdateBase& base, std::vector<NamedDigest> first) {
  PlannedTask task;
  task.kind = kBaseKind;
  task.name = absl::StrCat(kBaseKind, " ", base.name);
  for (size_t t = 0; t < base.tiles.size(); ++t) {
    if (base.tiles[t].core.empty()) continue;
    first.push_back({TileInputName(base.tiles[t].tile, kStateFile), base.states[t]});
  }
  if (base.outdated) first.push_back({kOutdatedFile, *base.outdated});
  if (base.borders) first.push_back({kBordersFile, *base.borders});
  task.given.Edit() = std::move(first);
  return task;
}

StatusOr<std::vector<PlannedTask>> PlanRollback(const UpdateBase& base) {
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(base.survey_json));
  PublishParameters parameters;
  parameters.tiles = base.tiles;
  SetReported(survey, &parameters);
  parameters.flip_edges = base.flip_edges;
  PlannedTask publish;
  publish.kind = publish.name = kPublishKind;
  SetCost(PredictPublish(survey), &publish);
  publish.inputs = {{TaskId(0), kCityFile}, {TaskId(0), kPlainSurveyFile}};
  for (const TileParameters& tile : base.tiles) {
    if (!tile.core.empty()) publish.inputs.push_back({TaskId(0), TileInputName(tile.tile, kStateFile)});
  }
  // A rollback does not change which faces are outdated.
  if (base.outdated) publish.inputs.push_back({TaskId(0), kOutdatedFile});
  parameters.outdated = base.outdated.has_value();
  publish.parameters = ToJson(parameters);
  // Contains the class borders for a later update of this job.
  return std::vector<PlannedTask>{
      BaseTask(base, {{kSurveyFile, base.survey}, {kPlainSurveyFile, base.plain}, {kCityFile, base.city}}),
      std::move(publish)};
}

}  // namespace tessera
