#include "common/job/refine_steps.h"

#include <gtest/gtest.h>

namespace tessera {
namespace {

TEST(RefineSteps, EachLevelEndsOncePerRound) {
  const auto steps = MakeRefineSteps({2, 0}, {3, 1}, 2, false, false);
  std::string order;
  for (const RefineStep& step : steps) {
    order += step.labels() ? "L" : std::to_string(step.level);
    if (step.ends_level) order += "|";
  }
  EXPECT_EQ(order, "L222|0|L0|L");
  EXPECT_TRUE(steps[0].first());
  EXPECT_FALSE(steps[5].first());
}

TEST(RefineSteps, LaterRoundsOfTheDefaultMethodHaveHalfTheIterations) {
  MethodSettings settings;
  settings.levels = {1, 0};
  settings.iterations = {4, 5};
  const auto iterations = [&](const std::string& method) {
    std::string text;
    int count = 0;
    for (const RefineStep& step : RefineStepsOf(method, 3, settings)) {
      count += !step.labels();
      if (step.ends_level) text += std::to_string(count) + " ", count = 0;
    }
    return text;
  };
  EXPECT_EQ(iterations("tessera"), "4 5 3 3 ");
  EXPECT_EQ(iterations("paper"), "4 5 5 5 ");
}

TEST(RefineSteps, IterationsAlternateTheDirections) {
  MethodSettings settings;
  const auto directions = [&](const std::string& method) {
    std::string text;
    for (const RefineStep& step : RefineStepsOf(method, 2, settings)) {
      text += step.labels() ? 'L' : "bfr"[static_cast<int>(step.directions)];
    }
    return text;
  };
  EXPECT_EQ(directions("tessera"), "LfrfrfrfrfrfrfrfrfrLfrfL");
  EXPECT_EQ(directions("paper"), "L" + std::string(20, 'b') + "L" + std::string(8, 'b') + "L");
  settings.iterations = {1, 1, 1};
  EXPECT_EQ(directions("tessera"), "LfrfLrL") << "levels and rounds of one iteration";
}

TEST(RefineSteps, SettingsOverrideTheMethodsRules) {
  EXPECT_TRUE(MethodRulesOf("tessera", 0, {}).labels_first);
  EXPECT_TRUE(MethodRulesOf("", 0, {}).labels_first);
  EXPECT_FALSE(MethodRulesOf("baseline", 0, {}).labels_first);
  EXPECT_FALSE(MethodRulesOf("baseline", 0, {}).geometry_uses_labels);
  EXPECT_FALSE(MethodRulesOf("paper", 0, {}).labels_first);
  EXPECT_TRUE(MethodRulesOf("paper", 0, {}).geometry_uses_labels);
  EXPECT_EQ(MethodRulesOf("paper", 0, {}).rounds, kPaperRounds);
  EXPECT_EQ(MethodRulesOf("paper", 2, {}).rounds, 2);
  EXPECT_EQ(MethodRulesOf("tessera", 0, {}).rounds, kTesseraRounds);
  EXPECT_EQ(MethodRulesOf("", 0, {}).rounds, kTesseraRounds);
  EXPECT_EQ(MethodRulesOf("baseline", 0, {}).rounds, kBaselineRounds);
  EXPECT_TRUE(MethodRulesOf("tessera", 0, {}).flips_edges);
  for (const char* method : {"baseline", "paper", "labels"}) EXPECT_FALSE(MethodRulesOf(method, 0, {}).flips_edges);
  MethodSettings other;
  other.flip_edges = true;
  EXPECT_TRUE(MethodRulesOf("paper", 0, other).flips_edges);
  other.flip_edges = false;
  EXPECT_FALSE(MethodRulesOf("tessera", 0, other).flips_edges);
  other.labels_first = false;
  EXPECT_FALSE(MethodRulesOf("tessera", 0, other).labels_first);
  other.labels_first = true;
  EXPECT_TRUE(MethodRulesOf("baseline", 0, other).labels_first);
}

TEST(RefineSteps, FinePartBeginsAtTheLastLevelOfTheFirstRound) {
  const auto first = [](const std::string& method, const std::vector<int>& levels) {
    MethodSettings settings;
    settings.levels = levels;
    settings.iterations.assign(levels.size(), 2);
    return FirstFineStep(RefineStepsOf(method, 3, settings), MethodRulesOf(method, 3, settings));
  };
  EXPECT_EQ(first("tessera", {2, 1, 0}), 1 + 2 + 2);
  EXPECT_EQ(first("", {2, 1}), 1 + 2);
  EXPECT_EQ(first("tessera", {0}), 0) << "there are no coarse levels";
  EXPECT_EQ(first("baseline", {2, 1, 0}), 0);
  EXPECT_EQ(first("paper", {2, 1, 0}), 0);
  EXPECT_EQ(FirstFineStep(RefineStepsOf("labels", 0, {}), MethodRulesOf("labels", 0, {})), 0);
  for (int step = 0; step < 9; ++step) {
    EXPECT_TRUE(IsStepOf(JobPart::kWhole, step, 5));
    EXPECT_EQ(IsStepOf(JobPart::kCoarse, step, 5), step < 5);
    EXPECT_EQ(IsStepOf(JobPart::kFine, step, 5), step >= 5);
  }
}

TEST(RefineSteps, LabelsMethodHasOneStep) {
  const auto steps = RefineStepsOf("labels", 0, {});
  const MethodRules rules = MethodRulesOf("labels", 0, {});
  ASSERT_EQ(steps.size(), 2u);
  EXPECT_EQ(ActiveSteps(steps, rules, {4, true, true}), std::vector<int>{1});
  EXPECT_EQ(ActiveSteps(steps, rules, {4, true, false}), std::vector<int>{1});
  EXPECT_TRUE(ActiveSteps(steps, rules, {4, false, true}).empty());
}

TEST(RefineSteps, LabelStepsActOnlyIfLabelsCanChange) {
  const auto steps = MakeRefineSteps({0}, {2}, 1, false, false);  // L00L
  const auto active = [&](const MethodRules& rules, const LabelTraits& scene) {
    std::string text;
    for (const int step : ActiveSteps(steps, rules, scene)) text += std::to_string(step);
    return text;
  };
  const LabelTraits labelled = {4, true, true}, unlabelled = {4, true, false};
  EXPECT_EQ(active({1, true, true}, labelled), "0123");
  EXPECT_EQ(active({1, false, true}, labelled), "123");
  EXPECT_EQ(active({1, false, true}, unlabelled), "0123");
  EXPECT_EQ(active({1, false, false}, unlabelled), "123");
  EXPECT_EQ(active({1, true, false}, unlabelled), "0123");
  EXPECT_EQ(active({1, true, true}, {1, true, false}), "12") << "one class is no class";
  EXPECT_EQ(active({1, true, true}, {4, false, false}), "12");
}

}  // namespace
}  // namespace tessera
