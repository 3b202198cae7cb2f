// How much work the steps of a job are.
#include <algorithm>
#include <cmath>

#include "server/tiling/cost_model.h"

namespace tessera {
namespace {

// Of the faces that the second split would add to the unmoved mesh, those that it adds to the moved one (cost_bench).
constexpr double kMovedSplitShare = 0.9;

}  // namespace

RefineEffort EffortOf(const RefineStep& step) {
  RefineEffort effort;
  if (step.labels()) {
    effort.labellings = 1;
  } else {
    effort.evaluations = effort.finest_share = std::ldexp(1.0, -2 * step.level);
    effort.warps = (step.directions == PairDirections::kBoth ? 1 : 0.5) * effort.evaluations;
    effort.iterations = 1;
    effort.widths = std::ldexp(1.0, -step.level);
    effort.mends = step.ends_level ? 1 : 0;
  }
  return effort;
}

RefineEffort EffortOf(const std::vector<RefineStep>& steps, const std::vector<int>& which) {
  RefineEffort sum;
  for (const int step : which) {
    const RefineEffort effort = EffortOf(steps[step]);
    sum.evaluations += effort.evaluations;
    sum.warps += effort.warps;
    sum.iterations += effort.iterations;
    sum.widths += effort.widths;
    sum.finest_share = std::max(sum.finest_share, effort.finest_share);
    sum.labellings += effort.labellings;
    sum.mends += effort.mends;
  }
  return sum;
}

std::vector<RefineStep> StepsOf(const JobSettings& settings) {
  return RefineStepsOf(settings.method, settings.rounds, settings.method_settings);
}

std::vector<int> ActiveStepsOf(const JobSettings& settings, const Survey& survey) {
  const LabelTraits traits = {static_cast<int>(survey.classes.size()), survey.has_likelihoods, survey.has_labels};
  return ActiveSteps(StepsOf(settings), MethodRulesOf(settings.method, settings.rounds, settings.method_settings),
                     traits);
}

int FirstFineStepOf(const JobSettings& settings) {
  return FirstFineStep(StepsOf(settings),
                       MethodRulesOf(settings.method, settings.rounds, settings.method_settings));
}

JobEffort EffortOf(const JobSettings& settings, const Survey& survey) {
  const std::vector<RefineStep> steps = StepsOf(settings);
  std::vector<int> coarse, fine;
  const int first_fine = FirstFineStepOf(settings);
  for (const int s : ActiveStepsOf(settings, survey)) (s < first_fine ? coarse : fine).push_back(s);
  JobEffort effort = {EffortOf(steps, coarse), EffortOf(steps, fine)};
  (effort.has_parts() ? effort.coarse : effort.fine).mends += 1;  // repair of the start
  if (effort.has_parts() && survey.faces > 0) {
    effort.coarse_faces =
        static_cast<double>(survey.faces) / static_cast<double>(AfterSecondSplit(survey, effort).faces);
  }
  return effort;
}

Survey AfterSecondSplit(Survey survey, const JobEffort& effort) {
  if (!effort.has_parts()) return survey;
  survey.faces = 0;
  for (SurveyCell& cell : survey.cells) {
    const auto added = static_cast<double>(std::max<int64_t>(0, cell.fine_faces - cell.faces));
    cell.faces += std::llround(kMovedSplitShare * added);
    survey.faces += cell.faces;
  }
  return survey;
}

}  // namespace tessera
