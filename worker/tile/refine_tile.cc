#include "worker/tile/refine_tile.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/base/elapsed.h"
#include "common/geometry/edge_list.h"
#include "common/job/refine_steps.h"
#include "worker/visibility/rasterizer.h"
#include "worker/visibility/visible_cells.h"

namespace tessera {
namespace {

using Eigen::Vector3d;
using nlohmann::json;

constexpr float kFrozenCost = 1e9f;  // of another label than a frozen face has: more than any edges weigh
constexpr float kCertainCost = 10;   // of another label than the one that is carried through

int64_t CountDifferent(const std::vector<int32_t>& a, const std::vector<int32_t>& b) {
  int64_t count = 0;
  for (size_t i = 0; i < a.size(); ++i) count += a[i] != b[i];
  return count;
}

}  // namespace

StatusOr<FaceLikelihoods> SumLikelihoods(const TilePackage& package, const std::vector<uint8_t>& own,
                                         const std::vector<Vector3d>& positions, const std::vector<TileView>& views,
                                         const ViewGroups& groups, const TaskControl& control) {
  const TriangleMesh mesh = {positions, package.mesh.faces, {}};
  const CellBoxes boxes(mesh, &package.cells);
  FaceLikelihoods sums(mesh.faces.size(), static_cast<int>(package.classes.size()));
  Rasterizer rasterizer;
  std::vector<FaceMap> maps;
  CellSightProblem problem;
  problem.boxes = boxes.boxes();
  for (const TileView& view : views) problem.views.push_back(view.window);
  problem.own = OwnCellsOfViews(package.cells, own, groups.looks, views.size());
  const CellSight sight = FindCellSight(problem);
  for (size_t v = 0; v < views.size(); ++v) {
    if (sight.windows[v].empty()) continue;
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(static_cast<double>(v) / static_cast<double>(views.size()), "collecting likelihoods");
    if (!views[v].pixels->has_likelihoods()) continue;
    TESSERA_ASSIGN_OR_RETURN(const StoredTexels level, views[v].pixels->Level(0));
    const FloatImage likelihoods = LikelihoodImage(level);
    const CameraWindow window(views[v].window.camera, sight.windows[v]);
    const MeshPart part = boxes.PartOf(sight.cells[v]);
    rasterizer.DrawParts(mesh, {&part, 1}, {&window, 1}, &maps);
    MarkNotLookedAt(groups, v, &maps[0]);
    AddLikelihoods(maps[0], likelihoods, level.mapping, &sums);
  }
  return sums;
}

RegionLabels LabelRegion(const TilePackage& package, const RegionMesh& region, const std::vector<Vector3d>& positions,
                         const std::vector<int32_t>& start, const FaceLikelihoods& sums,
                         const TileRefineOptions& options, const std::vector<uint8_t>& frozen) {
  const TriangleMesh mesh = {positions, region.mesh.faces, {}};
  LabelField field =
      BuildLabelField(mesh, EdgeList(mesh.faces), sums, package.classes, package.up, package.gsd_m, options.label);
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
  out.start_energy = labelling.start_energy;
  out.energy = labelling.energy;
  return out;
}

float CarriedConfidence(int classes, int32_t label) {
  return label < 0 ? 0.0f : 1 / (1 + static_cast<float>(classes - 1) * std::exp(-kCertainCost));
}

namespace {

// The whole city between its steps.
class CityRefiner {
 public:
  CityRefiner(TileWorkspace& work, const std::vector<TileView>& views, const TileRefineOptions& options,
              const Clock& clock)
      : package_(work.package()),
        own_(work.measured()),
        whole_(work.region(kCoreRegion)),
        views_(views),
        options_(options),
        clock_(clock),
        knows_labels_(GeometryKnowsLabels(package_, options)),
        data_(MakeTileData(package_, views, knows_labels_)),
        snapshot_(*work.Assemble({}, 0)) {}

  Status Labels(const TaskControl& control, json* report) {
    if (!LabelsChange(package_)) return absl::OkStatus();
    const int64_t start_us = clock_.MonotonicUs();
    TESSERA_ASSIGN_OR_RETURN(const FaceLikelihoods sums, SumLikelihoods(package_, own_, snapshot_.positions, views_,
                                                                        data_.groups, PartOf(control, 0, 0.8)));
    control.Report(0.8, "labelling");
    RegionLabels labelled = LabelRegion(package_, whole_, snapshot_.positions, snapshot_.labels, sums, options_);
    (*report)["label_energy_start"] = labelled.start_energy;
    (*report)["label_energy_end"] = labelled.energy;
    (*report)["label_changes"] = CountDifferent(snapshot_.labels, labelled.labels);
    snapshot_.labels = std::move(labelled.labels);
    snapshot_.confidence = std::move(labelled.confidence);
    refinement_.seconds_labels += SecondsSince(clock_, start_us);
    return absl::OkStatus();
  }

  Status Geometry(int round, const TaskControl& control, json* report) {
    // Where nothing is compared, what is left would only smooth.
    if (!package_.compares || data_.pairs.empty() || options_.geometry.levels.empty()) return absl::OkStatus();
    RefineProblem problem;
    problem.mesh = {snapshot_.positions, package_.mesh.faces, {}};
    if (knows_labels_) problem.mesh.labels = snapshot_.labels;
    if (round > 0) problem.start = package_.mesh.vertices;
    problem.cells = package_.cells;
    problem.views = data_.views;
    problem.groups = data_.groups;
    problem.gsd_m = package_.gsd_m;
    problem.pairs = data_.pairs;
    problem.up = package_.up;
    RefineOptions geometry = options_.geometry;
    geometry.clock = &clock_;
    const auto first = static_cast<std::ptrdiff_t>(FirstLevelOf(round, geometry.levels.size()));
    geometry.levels.erase(geometry.levels.begin(), geometry.levels.begin() + first);
    geometry.iterations.erase(geometry.iterations.begin(), geometry.iterations.begin() + first);
    TESSERA_ASSIGN_OR_RETURN(const RefineReport r, RefineGeometry(problem, &snapshot_.positions, geometry, control));
    // Only energies of one level compare.
    for (const RefineIteration& iteration : r.iterations) {
      if (iteration.level != geometry.levels.back()) continue;
      if (!report->contains("photo_energy_start")) (*report)["photo_energy_start"] = iteration.energy;
      (*report)["photo_energy_end"] = iteration.energy;
    }
    (*report)["warped_pixels"] = r.warped_pixels;
    refinement_.left_faces += r.left_faces;
    refinement_.seconds_prepare += r.seconds_prepare;
    refinement_.seconds_visibility += r.seconds_visibility;
    refinement_.seconds_data += r.seconds_photo;
    refinement_.seconds_step += r.seconds_step;
    refinement_.seconds_repair += r.seconds_repair;
    return absl::OkStatus();
  }

  TileSnapshot& snapshot() { return snapshot_; }
  TileRefinement& refinement() { return refinement_; }
  const TilePackage& package() const { return package_; }

 private:
  const TilePackage& package_;
  const std::vector<uint8_t> own_;
  const RegionMesh& whole_;
  const std::vector<TileView>& views_;
  const TileRefineOptions& options_;
  const Clock& clock_;
  const bool knows_labels_;
  const TileData data_;
  TileSnapshot snapshot_;
  TileRefinement refinement_;
};

}  // namespace

StatusOr<TileRefinement> RefineTile(TileWorkspace& work, const std::vector<TileView>& views,
                                    const TileRefineOptions& options, const TaskControl& control, const Clock& clock) {
  CityRefiner refiner(work, views, options, clock);
  json report = {{"faces", work.package().mesh.faces.size()}, {"views", views.size()}, {"rounds", json::array()}};
  const double per_round = 1.0 / options.rounds;
  if (options.labels_first) {
    TESSERA_RETURN_IF_ERROR(refiner.Labels(PartOf(control, 0, 0.05), &report["labels_first"]));
  }
  for (int round = 0; round < options.rounds; ++round) {
    const TaskControl part = PartOf(control, 0.05 + 0.95 * round * per_round, 0.05 + 0.95 * (round + 1) * per_round);
    report["rounds"].push_back(json::object());
    json& of_round = report["rounds"].back();
    TESSERA_RETURN_IF_ERROR(refiner.Geometry(round, PartOf(part, 0, 0.95), &of_round));
    TESSERA_RETURN_IF_ERROR(refiner.Labels(PartOf(part, 0.95, 1), &of_round));
  }
  TileSnapshot& snapshot = refiner.snapshot();
  if (snapshot.confidence.empty()) {
    for (const int32_t label : snapshot.labels) {
      snapshot.confidence.push_back(CarriedConfidence(static_cast<int>(work.package().classes.size()), label));
    }
  }
  snapshot.report = report.dump();
  refiner.refinement().state = work.StateOf(snapshot);
  return std::move(refiner.refinement());
}

}  // namespace tessera
