#include "worker/tasks/refine_tile.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/geometry/topology.h"
#include "common/tile/refine_steps.h"
#include "worker/tasks/stages.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

using Eigen::Vector3d;
using nlohmann::json;

// What the views say of the mesh as it is now.
StatusOr<FaceLikelihoods> CollectLikelihoods(const RefineProblem& problem, int classes,
                                             const std::vector<TileView>& views, const TaskControl& control) {
  FaceLikelihoods sums(problem.mesh.faces.size(), classes);
  for (size_t v = 0; v < views.size(); ++v) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(0.8 * static_cast<double>(v) / views.size(), "collecting likelihoods");
    if (!views[v].pixels->has_likelihoods()) continue;
    TESSERA_ASSIGN_OR_RETURN(const FloatImage likelihoods, views[v].pixels->Likelihoods());
    FaceMap map = RasterizeFaces(problem.mesh, &problem.occluders, views[v].window);
    MarkNotLookedAt(problem.groups, v, &map);
    AddLikelihoods(map, likelihoods, views[v].mapping, &sums);
  }
  return sums;
}

// Beliefs of labels that nothing was asked about: they stay.
std::vector<float> CertainBeliefs(const std::vector<int32_t>& labels, int classes) {
  std::vector<float> beliefs(labels.size() * classes, 10.0f);
  for (size_t f = 0; f < labels.size(); ++f) {
    if (labels[f] >= 0) beliefs[f * classes + labels[f]] = 0;
  }
  return beliefs;
}

int64_t CountDifferent(const std::vector<int32_t>& a, const std::vector<int32_t>& b) {
  int64_t count = 0;
  for (size_t i = 0; i < a.size(); ++i) count += a[i] != b[i];
  return count;
}

RefineProblem MakeProblem(const TilePackage& package, const std::vector<TileView>& views, bool knows_labels) {
  RefineProblem problem;
  problem.mesh = package.mesh;
  if (!knows_labels) problem.mesh.labels.clear();
  problem.fixed_vertices = package.fixed;
  problem.occluders = package.occluders;
  problem.gsd_m = package.gsd_m;
  problem.up = package.up;
  problem.reach_m = kTileReachGsd * package.gsd_m;
  problem.groups.group_of_face = package.cell;
  for (const std::vector<int32_t>& cell : package.cell_views) {
    std::vector<uint8_t> looks;
    for (const TileView& view : views) looks.push_back(std::binary_search(cell.begin(), cell.end(), view.view));
    problem.groups.looks.push_back(std::move(looks));
  }
  std::vector<int> loaded(package.views.size(), -1);
  for (size_t v = 0; v < views.size(); ++v) {
    loaded[views[v].view] = static_cast<int>(v);
    const PixelRect& rect = views[v].window.rect;
    const auto& [near_m, far_m] = package.view_depths[views[v].view];
    problem.views.push_back({views[v].window.camera,
                             views[v].pixels,
                             knows_labels,
                             views[v].mapping,
                             rect.x0,
                             rect.y0,
                             {static_cast<float>(near_m), static_cast<float>(far_m)}});
  }
  for (const auto& [reference, other] : package.pairs) {
    if (loaded[reference] >= 0 && loaded[other] >= 0) problem.pairs.push_back({loaded[reference], loaded[other]});
  }
  return problem;
}

// How long a step takes beside others, roughly.
double Share(const RefineStep& step) { return step.labels() ? 1 : std::ldexp(1.0, -2 * step.level); }

// A tile between its steps.
class TileRefiner {
 public:
  TileRefiner(const TilePackage& package, const std::vector<TileView>& views, TileState state,
              const TileRefineOptions& options, const Clock& clock)
      : package_(package),
        views_(views),
        options_(options),
        clock_(clock),
        classes_(static_cast<int>(package.classes.size())),
        labels_change_(package.has_likelihoods && classes_ > 1),
        // One class is no class: what it could say is the same everywhere.
        geometry_knows_labels_(options.geometry_knows_labels && classes_ > 1),
        problem_(MakeProblem(package, views, geometry_knows_labels_)),
        labels_(package.mesh.labels),
        report_(json::parse(state.report)) {
    report_["faces"] = package.mesh.faces.size();
    report_["views"] = views.size();
    if (!report_.contains("rounds")) report_["rounds"] = json::array();
    if (state.positions.empty()) return;
    problem_.mesh.vertices = std::move(state.positions);
    part_.level_start = std::move(state.level_start);
    labels_ = std::move(state.labels);
  }

  // A start without any labels is given some first, for the geometry that asks for them (paper, section 3).
  Status LabelsFirst(const TaskControl& control) {
    const bool unlabelled = std::all_of(labels_.begin(), labels_.end(), [](int32_t l) { return l < 0; });
    if (!labels_change_ || (!options_.labels_first && !(geometry_knows_labels_ && unlabelled))) return absl::OkStatus();
    return SolveTileLabels(control, &report_["labels_first"]);
  }

  Status Labels(int round, const TaskControl& control) {
    return labels_change_ ? SolveTileLabels(control, &RoundReport(round)) : absl::OkStatus();
  }

  // Iterations [begin, end) of a round.
  Status Geometry(int round, int begin, int end, const TaskControl& control) {
    json& report = RoundReport(round);
    if (problem_.pairs.empty()) return absl::OkStatus();
    const int64_t start_us = clock_.MonotonicUs();
    if (geometry_knows_labels_) problem_.mesh.labels = labels_;
    problem_.start.clear();
    if (round > 0 || begin > 0) problem_.start = package_.mesh.vertices;
    std::vector<Vector3d> moved;
    part_.begin = begin;
    part_.end = end;
    TESSERA_ASSIGN_OR_RETURN(const RefineReport r,
                             RefineGeometry(problem_, &moved, options_.geometry, control, &part_));
    problem_.mesh.vertices = std::move(moved);
    // Only energies of one level compare.
    for (const RefineIteration& iteration : r.iterations) {
      if (iteration.level != options_.geometry.levels.back()) continue;
      if (!report.contains("photo_energy_start")) report["photo_energy_start"] = iteration.energy;
      report["photo_energy_end"] = iteration.energy;
    }
    report["moved_rms_m"] = r.moved_rms_m;
    report["moved_max_m"] = r.moved_max_m;
    report["pairs"] = r.pairs;
    report["warped_pixels"] = report.value("warped_pixels", int64_t{0}) + r.warped_pixels;
    refinement_.seconds_geometry += SecondsSince(clock_, start_us);
    return absl::OkStatus();
  }

  TileRefinement Take(bool all_steps_done) {
    TileResult& result = refinement_.result;
    result.tile = package_.tile;
    result.classes = classes_;
    result.vertex_ids = package_.vertex_ids;
    result.face_ids = package_.face_ids;
    result.positions = std::move(problem_.mesh.vertices);
    result.level_start = std::move(part_.level_start);
    if (!all_steps_done) {
      result.beliefs.clear();
      result.seen.clear();
    } else if (!labels_change_) {
      result.beliefs = CertainBeliefs(labels_, classes_);
      result.seen.assign(labels_.size(), 1);  // labels that are carried through are not inferred
    }
    result.labels = std::move(labels_);
    result.report = report_.dump();
    return std::move(refinement_);
  }

 private:
  json& RoundReport(int round) {
    json& rounds = report_["rounds"];
    while (static_cast<int>(rounds.size()) <= round) rounds.push_back(json::object());
    return rounds[round];
  }

  Status SolveTileLabels(const TaskControl& control, json* report) {
    const int64_t start_us = clock_.MonotonicUs();
    TESSERA_ASSIGN_OR_RETURN(const FaceLikelihoods sums, CollectLikelihoods(problem_, classes_, views_, control));
    control.Report(0.8, "labelling");
    TESSERA_ASSIGN_OR_RETURN(const MeshTopology topology, BuildTopology(package_.mesh));
    Labelling labelling = SolveLabels(BuildLabelField(problem_.mesh, EdgeList(topology), sums, package_.classes,
                                                      package_.up, package_.gsd_m, options_.label),
                                      labels_, options_.solver);
    (*report)["label_energy_start"] = labelling.start_energy;
    (*report)["label_energy_end"] = labelling.energy;
    (*report)["label_changes"] = CountDifferent(labels_, labelling.labels);
    labels_ = std::move(labelling.labels);
    TileResult& result = refinement_.result;
    result.beliefs = std::move(labelling.beliefs);
    result.seen.resize(labels_.size());
    for (size_t f = 0; f < result.seen.size(); ++f) result.seen[f] = sums.pixels[f] > 0;
    refinement_.seconds_labels += SecondsSince(clock_, start_us);
    return absl::OkStatus();
  }

  const TilePackage& package_;
  const std::vector<TileView>& views_;
  const TileRefineOptions& options_;
  const Clock& clock_;
  const int classes_;
  const bool labels_change_, geometry_knows_labels_;
  RefineProblem problem_;
  RefinePart part_;
  std::vector<int32_t> labels_;
  json report_;
  TileRefinement refinement_;
};

}  // namespace

StatusOr<TileRefinement> RefineTile(const TilePackage& package, const std::vector<TileView>& views, TileState state,
                                    const TileRefineOptions& options, const TaskControl& control, const Clock& clock) {
  const std::vector<RefineStep> steps =
      MakeRefineSteps(options.geometry.levels, options.geometry.iterations, options.rounds);
  const size_t begin = static_cast<size_t>(options.begin);
  const size_t end = std::min(static_cast<size_t>(options.end), steps.size());
  if (options.begin < 0 || begin >= end || (begin > 0) == state.positions.empty()) {
    return absl::InvalidArgumentError(absl::StrCat("tile ", package.tile, ": steps ", options.begin, " to ",
                                                   options.end, " of ", steps.size(),
                                                   state.positions.empty() ? " from the start" : ""));
  }
  TileRefiner refiner(package, views, std::move(state), options, clock);
  double work = 0, done = 0;
  for (size_t i = begin; i < end; ++i) work += Share(steps[i]);
  for (size_t i = begin, next = begin; i < end; i = next) {
    const double low = done / work;
    const RefineStep& first = steps[i];
    do {
      done += Share(steps[next++]);
    } while (next < end && !first.labels() && !steps[next].labels());
    const TaskControl part = PartOf(control, low, done / work);
    if (!first.labels()) {
      const int count = static_cast<int>(next - i);
      TESSERA_RETURN_IF_ERROR(refiner.Geometry(first.round, first.iteration, first.iteration + count, part));
    } else {
      TESSERA_RETURN_IF_ERROR(first.round < 0 ? refiner.LabelsFirst(part) : refiner.Labels(first.round, part));
    }
  }
  return refiner.Take(end == steps.size());
}

}  // namespace tessera
