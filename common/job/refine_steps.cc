#include "common/job/refine_steps.h"

namespace tessera {

size_t FirstLevelOf(int round, size_t levels) { return round > 0 && levels > 0 ? levels - 1 : 0; }

std::vector<RefineStep> MakeRefineSteps(const std::vector<int>& levels, const std::vector<int>& iterations, int rounds,
                                        bool short_rounds, bool alternate) {
  std::vector<RefineStep> steps = {RefineStep()};
  int moves = 0;  // iterations of all rounds
  for (int round = 0; round < rounds; ++round) {
    int iteration = 0;
    for (size_t i = FirstLevelOf(round, levels.size()); i < levels.size(); ++i) {
      const int count = short_rounds && round > 0 ? (iterations[i] + 1) / 2 : iterations[i];
      for (int k = 0; k < count; ++k) {
        RefineStep& step = steps.emplace_back(RefineStep{round, levels[i], iteration++, k + 1 == count});
        if (alternate) step.directions = moves++ % 2 == 0 ? PairDirections::kForward : PairDirections::kBackward;
      }
    }
    steps.push_back({round, -1, iteration});
  }
  return steps;
}

std::vector<RefineStep> RefineStepsOf(const std::string& method, int rounds, const MethodSettings& settings) {
  const MethodRules rules = MethodRulesOf(method, rounds, settings);
  if (!rules.moves) return MakeRefineSteps({}, {}, rules.rounds, rules.short_rounds, rules.alternate);
  return MakeRefineSteps(LevelsOf(settings), IterationsOf(method, settings), rules.rounds, rules.short_rounds,
                         rules.alternate);
}

MethodRules MethodRulesOf(const std::string& method, int rounds, const MethodSettings& settings) {
  MethodRules rules;
  if (method == "baseline") {
    rules.rounds = kBaselineRounds;
    rules.geometry_uses_labels = rules.labels_first = rules.flips_edges = rules.splits_twice = false;
  }
  if (method == "paper") {
    rules.rounds = kPaperRounds;
    rules.labels_first = rules.flips_edges = rules.short_rounds = rules.alternate = rules.splits_twice = false;
  }
  if (method == kLabelsMethod) {
    rules.rounds = 1;
    rules.geometry_uses_labels = rules.labels_first = rules.moves = rules.flips_edges = rules.splits_twice = false;
  }
  if (rounds > 0) rules.rounds = rounds;
  if (settings.labels_first) rules.labels_first = *settings.labels_first;
  if (settings.flip_edges) rules.flips_edges = *settings.flip_edges;
  return rules;
}

int FirstFineStep(const std::vector<RefineStep>& steps, const MethodRules& rules) {
  if (!rules.splits_twice) return 0;
  int first = 0;
  for (int s = 1; s < static_cast<int>(steps.size()) && steps[s].round <= 0; ++s) {
    if (!steps[s].labels() && !steps[s - 1].labels() && steps[s].level != steps[s - 1].level) first = s;
  }
  return first;
}

bool LabelStepActs(const RefineStep& step, const MethodRules& rules, const LabelTraits& scene) {
  // With fewer than two classes labels cannot change.
  if (!scene.has_likelihoods || scene.classes < 2) return false;
  return !step.first() || rules.labels_first || (rules.geometry_uses_labels && !scene.has_labels);
}

std::vector<int> ActiveSteps(const std::vector<RefineStep>& steps, const MethodRules& rules, const LabelTraits& scene) {
  std::vector<int> active;
  for (int i = 0; i < static_cast<int>(steps.size()); ++i) {
    if (!steps[i].labels() || LabelStepActs(steps[i], rules, scene)) active.push_back(i);
  }
  return active;
}

}  // namespace tessera
