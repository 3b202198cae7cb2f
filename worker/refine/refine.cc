#include "worker/refine/refine.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

Status CheckProblem(const RefineProblem& problem, const RefineOptions& options) {
  const auto bad = [](const std::string& what) { return absl::InvalidArgumentError("refinement: " + what); };
  if (!(problem.gsd_m > 0)) return bad("the ground sampling distance must be positive");
  if (!problem.fixed_vertices.empty() && problem.fixed_vertices.size() != problem.mesh.vertices.size()) {
    return bad(absl::StrCat(problem.fixed_vertices.size(), " flags for ", problem.mesh.vertices.size(), " vertices"));
  }
  if (!problem.start.empty() && problem.start.size() != problem.mesh.vertices.size()) {
    return bad(absl::StrCat(problem.start.size(), " starts for ", problem.mesh.vertices.size(), " vertices"));
  }
  for (const Triangle& face : problem.mesh.faces) {
    for (uint32_t v : face) {
      if (v >= problem.mesh.vertices.size()) return bad(absl::StrCat("a face names vertex ", v));
    }
  }
  for (size_t i = 0; i < problem.views.size(); ++i) {
    const RefineView& view = problem.views[i];
    const PinholeCamera& k = view.camera.intrinsics;
    const PixelRect rect = view.pixels != nullptr ? view.pixels->rect() : PixelRect();
    if (view.pixels == nullptr || rect.x0 < 0 || rect.y0 < 0 || rect.x1 > k.width || rect.y1 > k.height) {
      return bad(absl::StrCat("the image of view ", i, " is no part of the camera's"));
    }
  }
  const int views = static_cast<int>(problem.views.size());
  for (size_t p = 0; p < problem.pairs.size(); ++p) {
    const ViewPair& pair = problem.pairs[p];
    if (pair.reference < 0 || pair.reference >= views || pair.other < 0 || pair.other >= views ||
        pair.reference == pair.other || (p > 0 && problem.pairs[p - 1].reference > pair.reference)) {
      return bad(absl::StrCat("view pair ", p, " is out of range or order"));
    }
  }
  if (options.levels.empty() || options.levels.size() != options.iterations.size()) {
    return bad("levels and iterations must be as many, and at least one");
  }
  for (int level : options.levels) {
    if (level < 0 || level >= kTexelLevels) return bad(absl::StrCat("pyramid level ", level));
  }
  if (options.window_px % 2 == 0 || options.window_px < 3 || options.window_px > 2 * ZnccWindow::kMaxRadius + 1) {
    return bad(absl::StrCat("a window of ", options.window_px, " pixels; expected 3, 5, ... ",
                            2 * ZnccWindow::kMaxRadius + 1));
  }
  return absl::OkStatus();
}

double MeanEnergy(const ZnccSums& sums) { return sums.weight > 0 ? sums.energy / sums.weight : 0; }

double MeanSemanticEnergy(const ZnccSums& sums) {
  return sums.semantic_pixels > 0 ? sums.semantic_energy / static_cast<double>(sums.semantic_pixels) : 0;
}

double Rms(const std::vector<Vector3d>& moves) {
  double sum = 0;
  for (const Vector3d& m : moves) sum += m.squaredNorm();
  return moves.empty() ? 0 : std::sqrt(sum / static_cast<double>(moves.size()));
}

double Seconds(const Clock* clock) { return clock ? 1e-6 * static_cast<double>(clock->MonotonicUs()) : 0; }

// The descent with its state.
class Refiner {
 public:
  Refiner(const RefineProblem& problem, const RefineOptions& options)
      : problem_(problem),
        options_(options),
        mesh_(problem.mesh),
        start_(problem.start.empty() ? problem.mesh.vertices : problem.start) {
    const double start_s = Seconds(options.clock);
    stepper_.emplace(TriangleMesh{start_, problem.mesh.faces, problem.mesh.labels}, problem.fixed_vertices,
                     problem.gsd_m, problem.up, options);
    pairs_ = problem.pairs;
    if (pairs_.empty()) {
      std::vector<PosedCamera> cameras;
      for (const RefineView& view : problem.views) cameras.push_back(view.camera);
      PairOptions pair_options;
      constexpr double kRadians = 3.14159265358979323846 / 180;
      pair_options.partners = options.partners;
      pair_options.min_angle_rad = options.min_angle_deg * kRadians;
      pair_options.max_angle_rad = options.max_angle_deg * kRadians;
      pair_options.best_angle_rad = options.best_angle_deg * kRadians;
      pairs_ = SelectPairs(mesh_, cameras, pair_options);
    }
    data_.emplace(problem.views, pairs_, problem.groups, problem.cells.size() > 0 ? &problem.cells : nullptr, options);
    report_.pairs = static_cast<int>(pairs_.size());
    report_.seconds_prepare = Seconds(options.clock) - start_s;
    for (size_t i = 0; i < options.levels.size(); ++i) {
      total_work_ += options.iterations[i] * std::pow(0.25, options.levels[i]);
    }
  }

  StatusOr<RefineReport> Run(const TaskControl& control) {
    const std::vector<Vector3d> before = mesh_.vertices;
    if (problem_.start.empty()) mesh_.vertices = stepper_->guard().UnfoldedStart();
    Repair(before);
    for (size_t i = 0; i < options_.levels.size(); ++i) {
      const int level = options_.levels[i];
      const std::vector<Vector3d> level_start = mesh_.vertices;
      last_step_.clear();
      for (int k = 0; k < options_.iterations[i]; ++k) {
        TESSERA_RETURN_IF_ERROR(control.Check());
        control.Report(work_ / total_work_,
                       absl::StrCat("level ", level, ", step ", k + 1, " of ", options_.iterations[i]));
        TESSERA_RETURN_IF_ERROR(Descend(level, k));
      }
      Repair(level_start);
    }
    std::vector<Vector3d> moves(mesh_.vertices.size());
    for (size_t v = 0; v < moves.size(); ++v) {
      moves[v] = mesh_.vertices[v] - start_[v];
      report_.moved_max_m = std::max(report_.moved_max_m, moves[v].norm());
    }
    report_.moved_rms_m = Rms(moves);
    return report_;
  }

  std::vector<Vector3d> TakeVertices() { return std::move(mesh_.vertices); }

 private:
  Status Descend(int level, int iteration) {
    const double start_s = Seconds(options_.clock);
    TESSERA_RETURN_IF_ERROR(data_->EnterLevel(level));
    const double entered_s = Seconds(options_.clock);
    data_->Evaluate(mesh_, {}, options_.clock, &derivatives_);
    const double evaluated_s = Seconds(options_.clock);
    const PhotoSums& photo = derivatives_.photo;
    const std::vector<Vector3d> step = stepper_->Step(
        mesh_, GatherVertices(mesh_, stepper_->guard().faces_of_vertex(), photo.faces, derivatives_.contours), level,
        iteration, last_step_);
    for (size_t v = 0; v < step.size(); ++v) mesh_.vertices[v] += step[v];
    last_step_.assign(step.size(), {});
    for (size_t v = 0; v < step.size(); ++v) last_step_[v] = step[v].cast<float>();
    report_.seconds_prepare += entered_s - start_s;
    report_.seconds_visibility += photo.seconds_visibility;
    report_.seconds_photo += evaluated_s - entered_s - photo.seconds_visibility;
    report_.seconds_step += Seconds(options_.clock) - evaluated_s;
    report_.warped_pixels += photo.warped_pixels;
    work_ += std::pow(0.25, level);
    report_.iterations.push_back({level, MeanEnergy(photo.sums), MeanSemanticEnergy(photo.sums),
                                  Rms(step) / std::ldexp(problem_.gsd_m, level), photo.sums.windows});
    return absl::OkStatus();
  }

  void Repair(const std::vector<Vector3d>& good) {
    const double start_s = Seconds(options_.clock);
    const FoldRepair::Result repaired = stepper_->Repair(good, &mesh_.vertices);
    report_.repaired_vertices += repaired.changed_vertices;
    report_.left_faces += static_cast<int64_t>(repaired.left.size());
    report_.seconds_repair += Seconds(options_.clock) - start_s;
  }

  const RefineProblem& problem_;
  const RefineOptions& options_;
  TriangleMesh mesh_;
  const std::vector<Vector3d> start_;
  std::vector<ViewPair> pairs_;
  std::optional<Stepper> stepper_;
  std::optional<DataTerm> data_;
  FaceDerivatives derivatives_;
  std::vector<Eigen::Vector3f> last_step_;  // of the level at hand; empty before its first
  double work_ = 0, total_work_ = 0;
  RefineReport report_;
};

}  // namespace

StatusOr<RefineReport> RefineGeometry(const RefineProblem& problem, std::vector<Vector3d>* vertices,
                                      const RefineOptions& options, const TaskControl& control) {
  TESSERA_RETURN_IF_ERROR(CheckProblem(problem, options));
  Refiner refiner(problem, options);
  TESSERA_ASSIGN_OR_RETURN(RefineReport report, refiner.Run(control));
  *vertices = refiner.TakeVertices();
  return report;
}

}  // namespace tessera
