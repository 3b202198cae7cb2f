#include "worker/refine/refine.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/imaging/pyramid.h"
#include "worker/refine/contour_term.h"
#include "worker/refine/descent.h"
#include "worker/refine/inter_term.h"
#include "worker/refine/photo_term.h"
#include "worker/refine/self_intersection.h"
#include "worker/refine/smooth_term.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr int kMaxLevel = 5;

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
    if (view.pixels == nullptr || view.x0 < 0 || view.y0 < 0 || view.x0 + view.pixels->width() > k.width ||
        view.y0 + view.pixels->height() > k.height) {
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
    if (level < 0 || level > kMaxLevel) return bad(absl::StrCat("pyramid level ", level));
  }
  if (options.window_px % 2 == 0 || options.window_px < 3 || options.window_px > 2 * ZnccWindow::kMaxRadius + 1) {
    return bad(absl::StrCat("a window of ", options.window_px, " pixels; expected 3, 5, ... ",
                            2 * ZnccWindow::kMaxRadius + 1));
  }
  return absl::OkStatus();
}

Status CheckPart(const RefineProblem& problem, const RefineOptions& options, const RefinePart& part) {
  const auto bad = [](const std::string& what) { return absl::InvalidArgumentError("refinement: " + what); };
  const int count = std::accumulate(options.iterations.begin(), options.iterations.end(), 0);
  if (part.begin < 0 || part.begin > std::min(part.end, count)) {
    return bad(absl::StrCat("iterations ", part.begin, " to ", part.end, " of ", count));
  }
  if (part.begin == 0) return absl::OkStatus();
  if (problem.start.empty()) return bad("a later part needs the start");
  int level_begin = 0;
  for (const int iterations : options.iterations) {
    if (part.begin > level_begin && part.begin < level_begin + iterations &&
        part.level_start.size() != problem.mesh.vertices.size()) {
      return bad(absl::StrCat(part.level_start.size(), " positions of the level's start for ",
                              problem.mesh.vertices.size(), " vertices"));
    }
    level_begin += iterations;
  }
  return absl::OkStatus();
}

// The part of the photograph that is at hand, its corners on pixel edges of `level`; in pixels of level 0.
PixelRect ViewWindow(const RefineView& view, int level) {
  const int align = 1 << level, step = PhotoView::kWindowStep * align;
  const PinholeCamera& k = view.camera.intrinsics;
  const auto up = [align](int x, int size) { return std::min((x + align - 1) / align, size / align) * align; };
  return {view.x0 / step * step, view.y0 / step * step, up(view.x0 + view.pixels->width(), k.width),
          up(view.y0 + view.pixels->height(), k.height)};
}

StatusOr<PhotoView> MakePhotoView(const RefineView& view, int level, bool semantic, int silhouette_px) {
  const PixelRect rect = ViewWindow(view, level);
  PhotoView out;
  out.camera = PyramidCamera(view.camera, level);
  // Pixels count from the middle of the whole image, where floats hold them best; from an even one (Texels).
  PinholeCamera& k = out.camera.intrinsics;
  const int middle_x = k.width / 4 * 2, middle_y = k.height / 4 * 2;
  k.cx -= middle_x;
  k.cy -= middle_y;
  out.depths = view.depths;
  TESSERA_ASSIGN_OR_RETURN(const FarSilhouettes silhouettes, view.pixels->Silhouettes());
  out.blind =
      silhouettes.Near(level, {rect.x0 >> level, rect.y0 >> level, rect.x1 >> level, rect.y1 >> level}, silhouette_px);
  FloatImage image(rect.width(), rect.height());
  {
    TESSERA_ASSIGN_OR_RETURN(const FloatImage luminance, view.pixels->Luminance());
    for (int y = 0; y < rect.height(); ++y) {
      for (int x = 0; x < rect.width(); ++x) {
        const int sx = rect.x0 + x - view.x0, sy = rect.y0 + y - view.y0;
        const bool inside = sx >= 0 && sy >= 0 && sx < luminance.width && sy < luminance.height;
        image.at(x, y) = inside ? luminance.at(sx, sy) : std::nanf("");
      }
    }
  }
  for (int i = 0; i < level; ++i) image = HalfResolution(image);
  const int x0 = (rect.x0 >> level) - middle_x, y0 = (rect.y0 >> level) - middle_y;
  if (!semantic || !view.asks_likelihoods || !view.pixels->has_likelihoods()) {
    out.texels = MakeTexels(image, x0, y0);
  } else {
    TESSERA_ASSIGN_OR_RETURN(const FloatImage likelihoods, view.pixels->Likelihoods());
    PixelMapping mapping = view.mapping;
    mapping.scale_x *= 1 << level;
    mapping.scale_y *= 1 << level;
    mapping.offset_x += mapping.scale_x * middle_x;
    mapping.offset_y += mapping.scale_y * middle_y;
    out.texels = MakeTexels(image, likelihoods, mapping, x0, y0);
  }
  return out;
}

PhotoOptions MakePhotoOptions(const RefineOptions& options) {
  PhotoOptions out;
  out.window = MakeWindow(options.window_px, options.gaussian_window);
  out.window.min_valid = static_cast<float>(options.min_valid);
  out.window.min_variance = static_cast<float>(options.min_sigma * options.min_sigma);
  out.window.max_mean_difference = static_cast<float>(options.max_mean_difference);
  out.window.max_variance_ratio = static_cast<float>(options.max_variance_ratio);
  out.window.epsilon = 1e-6f;
  out.window.noise_variance = static_cast<float>(options.noise_sigma * options.noise_sigma);
  out.min_cosine = options.min_cosine;
  out.window.outlier = static_cast<float>(options.photo_outlier);
  out.semantic = {static_cast<float>(options.semantic), static_cast<float>(options.semantic_outlier)};
  out.occlusion_px = options.occlusion_px;
  return out;
}

MotionLimits MakeMotionLimits(const RefineProblem& problem, const RefineOptions& options) {
  MotionLimits out;
  out.max_normal_m = options.max_normal_gsd * problem.gsd_m;
  out.max_tangent_m = options.max_tangent_gsd * problem.gsd_m;
  out.min_start_cosine = options.min_start_cosine;
  out.start_smoothing_steps = options.start_smoothing_steps;
  return out;
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

// The descent with its state: positions, views of the level at hand, report.
class Refiner {
 public:
  Refiner(const RefineProblem& problem, const RefineOptions& options)
      : problem_(problem),
        options_(options),
        mesh_(problem.mesh),
        start_{problem.start.empty() ? problem.mesh.vertices : problem.start, problem.mesh.faces, {}},
        smooth_(start_, problem.fixed_vertices),
        inter_(start_, problem.fixed_vertices),
        guard_(start_, problem.fixed_vertices, MakeMotionLimits(problem, options)) {
    double start_s = Seconds(options.clock);
    smooth_.SetLabels(problem.mesh.labels, options.classes, options.mixed);
    if (options.inter > 0) inter_.SetLabels(problem.mesh.labels);
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
    report_.pairs = static_cast<int>(pairs_.size());
    report_.seconds_prepare = Seconds(options.clock) - start_s;
    for (size_t stage = 0; stage < options.levels.size(); ++stage) {
      for (int i = 0; i < options.iterations[stage]; ++i) steps_.push_back({stage, i});
    }
  }

  StatusOr<RefineReport> Run(const TaskControl& control, RefinePart* part) {
    const int count = static_cast<int>(steps_.size()), begin = part->begin, end = std::min(part->end, count);
    for (int i = begin; i < end; ++i) total_work_ += std::pow(0.25, Level(i));
    if (begin == 0) {
      const std::vector<Vector3d> start = mesh_.vertices;
      if (problem_.start.empty()) mesh_.vertices = guard_.UnfoldedStart();
      Repair(start);
    } else {
      level_start_ = std::move(part->level_start);
    }
    for (int i = begin; i < end; ++i) TESSERA_RETURN_IF_ERROR(Descend(i, control));
    part->level_start = std::move(level_start_);
    std::vector<Vector3d> moves(mesh_.vertices.size());
    for (size_t v = 0; v < moves.size(); ++v) {
      moves[v] = mesh_.vertices[v] - start_.vertices[v];
      report_.moved_max_m = std::max(report_.moved_max_m, moves[v].norm());
    }
    report_.moved_rms_m = Rms(moves);
    return report_;
  }

  std::vector<Vector3d> TakeVertices() { return std::move(mesh_.vertices); }

 private:
  Status EnterLevel(int level) {
    if (level == level_) return absl::OkStatus();
    const double start_s = Seconds(options_.clock);
    const bool semantic = options_.semantic > 0 || options_.contour > 0;
    const int radius_px = std::max(options_.window_px / 2, options_.silhouette_px >> level);
    photo_.reset();
    views_.assign(problem_.views.size(), PhotoView());
    photo_ = std::make_unique<PhotoTerm>(&views_, pairs_, MakePhotoOptions(options_), &problem_.groups);
    std::vector<Status> read(views_.size());
    ParallelFor(static_cast<int64_t>(views_.size()), 1, [&](int64_t begin, int64_t end) {
      for (int64_t i = begin; i < end; ++i) {
        StatusOr<PhotoView> view = MakePhotoView(problem_.views[i], level, semantic, radius_px);
        read[i] = view.status();
        if (!view.ok()) continue;
        views_[i] = *std::move(view);
        if (!options_.scratch_folder.empty()) read[i] = photo_->SpillTexels(i, options_.scratch_folder);
      }
    });
    for (const Status& status : read) TESSERA_RETURN_IF_ERROR(status);
    level_ = level;
    report_.seconds_prepare += Seconds(options_.clock) - start_s;
    return absl::OkStatus();
  }

  void Evaluate() {
    ContourOptions contour;
    contour.weight = options_.contour;
    contour.reach_m = problem_.reach_m;
    contour.up = problem_.up;
    std::vector<std::vector<ContourPull>> pulls(views_.size());
    const auto find_pulls = [&](size_t view, const FaceMap& map) {
      pulls[view] = ContourPulls(mesh_, problem_.mesh.labels, views_[view], map, contour);
    };
    const bool has_contours = options_.contour > 0 && !problem_.mesh.labels.empty();
    photo_->Evaluate(mesh_, problem_.occluders, options_.clock, &derivatives_,
                     has_contours ? PhotoTerm::MapVisitor(find_pulls) : nullptr);
    AddContourPulls(pulls, &derivatives_.gradient, &derivatives_.curvature);
    report_.seconds_visibility += derivatives_.seconds_visibility;
    report_.seconds_photo += derivatives_.seconds_photo;
    report_.warped_pixels += derivatives_.warped_pixels;
    work_ += std::pow(0.25, level_);
  }

  int Level(int step) const { return options_.levels[steps_[step].stage]; }

  Status Descend(int step_index, const TaskControl& control) {
    const auto [stage, iteration] = steps_[step_index];
    const int level = Level(step_index), iterations = options_.iterations[stage];
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(work_ / total_work_, absl::StrCat("level ", level, ", step ", iteration + 1, " of ", iterations));
    TESSERA_RETURN_IF_ERROR(EnterLevel(level));
    if (iteration == 0) level_start_ = mesh_.vertices;
    const double pixel_m = problem_.gsd_m * std::pow(2.0, level);
    StepOptions step_options;
    const double unit = 1 / (pixel_m * pixel_m);
    step_options.weights = {options_.thin_plate * unit, options_.membrane * unit, options_.rim * unit, unit,
                            options_.tangential};
    step_options.inter = options_.inter;
    step_options.up = problem_.up;
    step_options.smoothing_sweeps = options_.smoothing_sweeps;
    step_options.grid_m = std::exp2(std::floor(std::log2(options_.grid_gsd * problem_.gsd_m)));
    step_options.max_step_m = options_.max_step_px * pixel_m * std::pow(options_.step_decay, iteration);
    if (options_.tangential != 1) smooth_.SetNormals(mesh_.vertices);
    Evaluate();
    const double start_s = Seconds(options_.clock);
    const std::vector<Vector3d> step = ComputeStep(mesh_, derivatives_, smooth_, inter_, guard_, step_options);
    for (size_t v = 0; v < step.size(); ++v) mesh_.vertices[v] += step[v];
    report_.seconds_step += Seconds(options_.clock) - start_s;
    report_.iterations.push_back({level, MeanEnergy(derivatives_.sums), MeanSemanticEnergy(derivatives_.sums),
                                  Rms(step) / pixel_m, derivatives_.sums.windows});
    if (iteration + 1 == iterations) {
      Repair(level_start_);
      level_start_.clear();
    }
    return absl::OkStatus();
  }

  // Takes back what turned faces or made them cut each other since `good`.
  void Repair(const std::vector<Vector3d>& good) {
    const double start_s = Seconds(options_.clock);
    const auto keeps_facing = [&](uint32_t face, const auto& from, const auto& to) {
      return guard_.KeepsFacing(face, from, to);
    };
    if (!repair_) repair_.emplace(start_, guard_.faces_of_vertex());
    report_.repaired_vertices += repair_->Run(good, keeps_facing, &mesh_.vertices).changed_vertices;
    report_.seconds_repair += Seconds(options_.clock) - start_s;
  }

  const RefineProblem& problem_;
  const RefineOptions& options_;
  TriangleMesh mesh_;
  const TriangleMesh start_;
  SmoothTerm smooth_;
  InterTerm inter_;
  MotionGuard guard_;
  std::optional<FoldRepair> repair_;  // made when first needed: many parts have no end of a level
  struct StepIndex {
    size_t stage;   // of the options' levels
    int iteration;  // in it
  };
  std::vector<StepIndex> steps_;
  std::vector<Vector3d> level_start_;  // positions when the level at hand began
  std::vector<ViewPair> pairs_;
  std::vector<PhotoView> views_;
  std::unique_ptr<PhotoTerm> photo_;
  PhotoDerivatives derivatives_;
  int level_ = -1;
  double work_ = 0, total_work_ = 0;
  RefineReport report_;
};

}  // namespace

StatusOr<RefineReport> RefineGeometry(const RefineProblem& problem, std::vector<Vector3d>* vertices,
                                      const RefineOptions& options, const TaskControl& control, RefinePart* part) {
  TESSERA_RETURN_IF_ERROR(CheckProblem(problem, options));
  RefinePart all;
  if (part == nullptr) part = &all;
  TESSERA_RETURN_IF_ERROR(CheckPart(problem, options, *part));
  Refiner refiner(problem, options);
  TESSERA_ASSIGN_OR_RETURN(RefineReport report, refiner.Run(control, part));
  *vertices = refiner.TakeVertices();
  return report;
}

}  // namespace tessera
