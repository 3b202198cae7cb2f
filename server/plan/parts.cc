#include "server/plan/parts.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace tessera {
namespace {

constexpr int kStandardWindow_px = 7, kStandardCoarsest = 2;  // what the constants and the standard halo are for
constexpr double kBlendGsd = 16, kBlendShare = 0.25;          // the lesser of the two

// How far from a tile's cut vertices may differ from the whole city's: after one step, and how much farther with each
// one more, GSD, on level 0, 1 and 2 (coarser ones reach in proportion); labels reach as far on any. Measured by jobs
// of one step or few in one part on real surfaces (seam_bench, --settings with one level): the farthest vertex that
// differed at all, the worse of two scenes.
struct Reach {
  double first, next;
};
constexpr Reach kReachOfLevel[] = {{200, 28}, {210, 30}, {170, 50}}, kReachOfLabels = {60, 60};

Reach ReachOf(const RefineStep& step, double wider) {
  if (step.labels()) return kReachOfLabels;
  const int known = std::min<int>(step.level, std::size(kReachOfLevel) - 1);
  const double scale = wider * std::ldexp(1.0, step.level - known);
  return {scale * kReachOfLevel[known].first, scale * kReachOfLevel[known].next};
}

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
    const auto [first, next] = ReachOf(step, wider);
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
  if (tiles < 2) return {{0, static_cast<int>(steps.size())}};
  return SplitSteps(steps, method.window_px.value_or(kStandardWindow_px), HaloGsd(method) - BlendGsd(method));
}

}  // namespace tessera
