#include "worker/refine/stepper.h"

#include <cmath>
#include <functional>
#include <iterator>

#include "common/base/parallel.h"

namespace tessera {
namespace {

// With `rings` rings of vertices about those with a flag.
std::vector<uint8_t> Grown(std::vector<uint8_t> flags, const std::vector<Triangle>& faces, int rings) {
  for (int ring = 0; ring < rings && !flags.empty(); ++ring) {
    const std::vector<uint8_t> before = flags;
    for (const auto& [a, b, c] : faces) {
      if (before[a] || before[b] || before[c]) flags[a] = flags[b] = flags[c] = 1;
    }
  }
  return flags;
}

// StepOptions::max_step_m of an iteration.
double MaxStep_m(const StepperOptions& options, double gsd_m, int level, int iteration) {
  return options.max_step_px * std::ldexp(gsd_m, level) * std::pow(options.step_decay, iteration);
}

// StepOptions::grid_m.
double Grid_m(const StepperOptions& options, double gsd_m) {
  return std::exp2(std::floor(std::log2(options.grid_gsd * gsd_m)));
}

}  // namespace

MotionLimits MakeMotionLimits(const StepperOptions& options, double gsd_m) {
  MotionLimits out;
  out.max_normal_m = options.max_normal_gsd * gsd_m;
  out.max_tangent_m = options.max_tangent_gsd * gsd_m;
  out.min_start_cosine = options.min_start_cosine;
  out.start_smoothing_steps = options.start_smoothing_steps;
  return out;
}

double LongestStep_m(const StepperOptions& options, double gsd_m, int level, int iteration) {
  const double half_diagonal = std::sqrt(3.0) / 2;
  return (1 + 1e-6) * (MaxStep_m(options, gsd_m, level, iteration) + half_diagonal * Grid_m(options, gsd_m));
}

Stepper::Stepper(const StartSurface& start, const std::vector<int32_t>& labels, const std::vector<uint8_t>& boundary,
                 double gsd_m, const Eigen::Vector3d& up, const StepperOptions& options,
                 const std::vector<uint8_t>& active, const std::vector<uint8_t>& frozen)
    : options_(options), gsd_m_(gsd_m), up_(up), start_(start) {
  const std::vector<Triangle>& faces = start.mesh().faces;
  // Each takes time on one thread.
  const std::function<void()> parts[] = {
      [&] {
        smooth_.emplace(start_, UnionOfFlags(boundary, frozen), Grown(active, faces, MotionGuard::kFoldingPasses));
      },
      [&] {
        if (options.inter > 0) inter_.emplace(start_.mesh(), UnionOfFlags(boundary, frozen));
      },
      [&] { guard_.emplace(start_, boundary, MakeMotionLimits(options, gsd_m), frozen); }};
  ParallelForEach(std::size(parts), 1, [&](size_t i) { parts[i](); });
  SetLabels(labels);
}

void Stepper::SetLabels(const std::vector<int32_t>& labels) {
  smooth_->SetLabels(labels, options_.classes, options_.mixed);
  if (inter_) inter_->SetLabels(labels);
}

std::vector<Eigen::Vector3d> Stepper::Step(const std::vector<Eigen::Vector3d>& at, const PhotoDerivatives& derivatives,
                                           int level, int iteration, const std::vector<Eigen::Vector3f>& last) {
  const double pixel_m = std::ldexp(gsd_m_, level), unit = 1 / (pixel_m * pixel_m);
  StepOptions step;
  step.weights = {options_.thin_plate * unit, options_.membrane * unit, options_.rim * unit, unit};
  step.inter = options_.inter;
  step.up = up_;
  step.smoothing_sweeps = options_.smoothing_sweeps;
  step.grid_m = Grid_m(options_, gsd_m_);
  step.max_step_m = MaxStep_m(options_, gsd_m_, level, iteration);
  step.acceleration = options_.acceleration;
  step.half_effect_curvature = options_.half_effect_curvature * unit;
  smooth_->Reweight(at, options_.creases);
  return ComputeStep(at, derivatives, *smooth_, inter_ ? &*inter_ : nullptr, *guard_, step, last);
}

SurfaceRepair::Result Stepper::Repair(const std::vector<Eigen::Vector3d>& good,
                                      std::vector<Eigen::Vector3d>* positions) {
  if (!repair_) repair_.emplace(start_.mesh(), guard_->faces_of_vertex());
  const auto keeps_facing = [&](uint32_t face, const auto& from, const auto& to) {
    return guard_->KeepsOrientation(face, from, to);
  };
  return repair_->Run(good, keeps_facing, positions);
}

}  // namespace tessera
