#include "worker/tile/solve_tile.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/parallel.h"
#include "common/geometry/edge_list.h"
#include "worker/city/pick.h"
#include "worker/refine/vertex_sums.h"

namespace tessera {
namespace {

using Eigen::Vector3d;
using nlohmann::json;

constexpr int64_t kGrain = 8192;
constexpr float kFrozenCost = 1e9f;  // of changing the label of a frozen face: more than any edges weigh

json* RoundReport(const RefineStep& step, json* report) {
  if (step.round < 0) return &(*report)["labels_first"];
  json& rounds = (*report)["rounds"];
  while (static_cast<int>(rounds.size()) <= step.round) rounds.push_back(json::object());
  return &rounds[step.round];
}

void SolveLabelStep(TileWorkspace& work, const StepSums& sums, const TileRefineOptions& options, TileSnapshot* snapshot,
                    json* report) {
  const RegionMesh& region = work.region(kLabelRegion);
  const RegionLabels labelled = LabelRegion(work.package(), region, Pick(snapshot->positions, region.vertices),
                                            Pick(snapshot->labels, region.faces), sums.likelihoods, options,
                                            Pick(snapshot->frozen_faces, region.faces));
  snapshot->confidence.resize(snapshot->labels.size(), 0.0f);
  int64_t changes = 0;
  for (size_t i = 0; i < region.faces.size(); ++i) {
    const uint32_t f = region.faces[i];
    if (work.package().regions[f] & kCoreRegion) changes += snapshot->labels[f] != labelled.labels[i];
    snapshot->labels[f] = labelled.labels[i];
    snapshot->confidence[f] = labelled.confidence[i];
  }
  (*report)["label_changes"] = changes;
  work.Forget(kLabelRegion);
}

void SolveIteration(TileWorkspace& work, const TileStep& at, const StepSums& sums, const TileRefineOptions& options,
                    TileSnapshot* snapshot, json* report) {
  if (at.level_iteration == 0) {
    snapshot->level_start = snapshot->positions;
    snapshot->last_step.assign(snapshot->positions.size(), Eigen::Vector3f::Zero());
  }
  const RegionMesh& region = work.region(kSolveRegion);
  Stepper& stepper = work.SolveStepper(*snapshot, options);
  const std::vector<Vector3d> positions = Pick(snapshot->positions, region.vertices);
  const MeshSpans mesh(positions, region.mesh().faces);
  const FaceDerivatives& derivatives = sums.derivatives;
  const std::vector<Vector3d> step = stepper.Step(
      positions, GatherVertices(mesh, stepper.guard().faces_of_vertex(), derivatives.photo.faces, derivatives.contours),
      at.step.level, at.level_iteration, Pick(snapshot->last_step, region.vertices));
  ParallelForEach(step.size(), kGrain, [&](size_t v) {
    snapshot->positions[region.vertices[v]] = positions[v] + step[v];
    snapshot->last_step[region.vertices[v]] = step[v].cast<float>();
  });
  (*report)["warped_pixels"] = report->value("warped_pixels", int64_t{0}) + sums.warped_pixels;
  // Energies compare within one level alone.
  if (!at.finest || sums.energy < 0) return;
  if (!report->contains("photo_energy_start")) (*report)["photo_energy_start"] = sums.energy;
  (*report)["photo_energy_end"] = sums.energy;
}

}  // namespace

StatusOr<StepSums> AssembleSums(TileWorkspace& work, const SumsOfTiles& tiles, const TileStep& at,
                                const TileSnapshot& snapshot) {
  StepSums out;
  const auto own = std::find_if(tiles.begin(), tiles.end(),
                                [&](const auto& of_tile) { return of_tile->tile == work.package().tile; });
  if (own != tiles.end()) out.fit = (*own)->fit;
  if (at.labels()) {
    TESSERA_ASSIGN_OR_RETURN(out.likelihoods, work.AssembleLikelihoods(tiles, at.region(), snapshot.frozen_faces));
    return out;
  }
  if (!work.package().has_pairs) return out;
  TESSERA_ASSIGN_OR_RETURN(out.derivatives.photo.faces, work.AssemblePhoto(tiles, at.region(), snapshot.frozen_faces));
  TESSERA_ASSIGN_OR_RETURN(out.derivatives.contours, work.AssembleContours(tiles, at.region()));
  if (own != tiles.end()) {
    out.energy = (*own)->energy;
    out.semantic_energy = (*own)->semantic_energy;
    out.warped_pixels = (*own)->warped_pixels;
  }
  return out;
}

void Solve(TileWorkspace& work, const TileStep& at, const StepSums& sums, const TileRefineOptions& options,
           TileSnapshot* snapshot) {
  const std::vector<PixelRect>& rects = work.package().view_rects;
  json report = json::parse(snapshot->report);
  report["faces"] = work.core_faces().size();
  report["views"] = std::count_if(rects.begin(), rects.end(), [](const PixelRect& rect) { return !rect.empty(); });
  if (!report.contains("seams")) report["seams"] = {{"samples", 0}, {"different", 0}, {"farthest_m", 0.0}};
  json* of_round = RoundReport(at.step, &report);
  if (at.labels()) {
    SolveLabelStep(work, sums, options, snapshot, of_round);
  } else if (work.package().has_pairs) {
    SolveIteration(work, at, sums, options, snapshot, of_round);
  }
  if (!sums.fit.empty()) report["fit"] = json::parse(sums.fit);
  snapshot->report = report.dump();
}

RegionLabels LabelRegion(const TilePackage& package, const RegionMesh& region, const std::vector<Vector3d>& positions,
                         const std::vector<int32_t>& start, const FaceLikelihoods& sums,
                         const TileRefineOptions& options, const std::vector<uint8_t>& frozen) {
  LabelField field = BuildLabelField(MeshSpans(positions, region.mesh().faces), EdgeList(region.mesh().faces), sums,
                                     package.classes, package.up, package.gsd_m, options.label);
  field.cell = region.cell;
  for (size_t f = 0; f < frozen.size(); ++f) {
    if (!frozen[f] || start[f] < 0) continue;
    for (int l = 0; l < field.classes; ++l) field.unary[f * field.classes + l] = l == start[f] ? 0 : kFrozenCost;
  }
  Labelling labelling = SolveLabels(field, start, options.solver);
  RegionLabels out;
  out.confidence = LabelConfidence(field.classes, labelling.beliefs, labelling.labels);
  for (size_t f = 0; f < out.confidence.size(); ++f) {
    if (!(sums.pixels[f] > 0)) out.confidence[f] = 0;
  }
  out.labels = std::move(labelling.labels);
  return out;
}

}  // namespace tessera
