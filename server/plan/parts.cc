#include "server/plan/parts.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace tessera {
namespace {

constexpr int kStandardWindow_px = 7, kStandardCoarsest = 2;  // what the constants and the standard halo are for
constexpr double kBlendGsd = 16, kBlendShare = 0.25;          // the lesser of the two

// How far from the cut bits differ after the first step, and how much farther with each one more, GSD at level 0; a
// level l reaches 2^l times as far (measured, seam_bench).
double Env(const char* n, double d) { return getenv(n) ? atof(getenv(n)) : d; }
const double kFirstGsd = Env("TF", 38), kNextGsd = Env("TN", 15), kLabelsGsd = Env("TL", 60);

double WindowShare(const MethodSettings& settings) {
  return settings.window_px.value_or(kStandardWindow_px) / static_cast<double>(kStandardWindow_px);
}

}  // namespace

// Wider windows and coarser levels reach further in proportion; narrower ones leave the rest of the reach as it is.
double HaloGsd(const MethodSettings& settings) {
  if (settings.halo_gsd) return *settings.halo_gsd;
  const int coarsest =
      settings.levels.empty() ? kStandardCoarsest : *std::max_element(settings.levels.begin(), settings.levels.end());
  return kHaloGsd * std::max(1.0, std::ldexp(WindowShare(settings), coarsest - kStandardCoarsest));
}

double BlendGsd(const MethodSettings& settings) { return std::min(kBlendGsd, kBlendShare * HaloGsd(settings)); }

std::vector<StepRange> SplitSteps(const std::vector<RefineStep>& steps, int window_px, double reach_gsd) {
  const double wider = std::max(1.0, window_px / static_cast<double>(kStandardWindow_px));
  std::vector<StepRange> parts;
  double reached = 0;
  for (int i = 0; i < static_cast<int>(steps.size()); ++i) {
    const RefineStep& step = steps[i];
    const double scale = step.labels() ? 1 : std::ldexp(wider, step.level);
    const double first = scale * (step.labels() ? kLabelsGsd : kFirstGsd);
    const double next = scale * (step.labels() ? kLabelsGsd : kNextGsd);
    if (parts.empty() || reached + next > reach_gsd) {
      parts.push_back({i, i});
      reached = first;
    } else {
      reached = std::max(reached + next, first);
    }
    parts.back().end = i + 1;
  }
  return parts;
}

std::vector<StepRange> PartsOf(const JobSettings& settings, size_t tiles) {
  const MethodSettings& method = settings.method_settings;
  const std::vector<RefineStep> steps = RefineStepsOf(settings.method, settings.rounds, method);
  if (tiles < 2 && !getenv("TESS_PARTS")) return {{0, static_cast<int>(steps.size())}};
  return SplitSteps(steps, method.window_px.value_or(kStandardWindow_px), HaloGsd(method) - BlendGsd(method));
}

}  // namespace tessera
