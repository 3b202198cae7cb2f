#include "worker/tile/methods.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "common/job/refine_steps.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr LabelTraits kLabelled = {.classes = 2, .has_likelihoods = true, .has_labels = true};

std::vector<SceneClass> TwoClasses() {
  std::vector<SceneClass> classes(2);
  classes[0].smoothness = 3;
  classes[0].anchor_weight = 0.5;
  classes[1].smoothness = 0.25;
  return classes;
}

TileRefineOptions OptionsOf(const std::string& method, const MethodSettings& settings = {}, int rounds = 0) {
  const auto options = MethodOptions({rounds, method, settings}, TwoClasses());
  EXPECT_TRUE(options.ok()) << options.status();
  return options.ok() ? *options : TileRefineOptions();
}

bool LabelsFirst(const std::string& method, const MethodSettings& settings = {},
                 const LabelTraits& traits = kLabelled) {
  return LabelStepActs(RefineStep(), MethodRulesOf(method, 0, settings), traits);
}

// Level and round of each step.
std::vector<std::array<int, 2>> StepsOf(const std::string& method, const MethodSettings& settings = {},
                                        int rounds = 0) {
  std::vector<std::array<int, 2>> steps;
  for (const RefineStep& step : RefineStepsOf(method, rounds, settings)) steps.push_back({step.level, step.round});
  return steps;
}

TEST(Methods, EachMethodHasItsTerms) {
  const TileRefineOptions ours = OptionsOf("tessera"), baseline = OptionsOf("baseline"), paper = OptionsOf("paper");
  EXPECT_TRUE(ours.geometry_uses_labels);
  EXPECT_TRUE(LabelsFirst("tessera"));
  EXPECT_EQ(ours.data.semantic, 0);
  EXPECT_EQ(ours.step.inter, 0);
  EXPECT_EQ(ours.label.form, LabelOptions::Form::kTessera);
  EXPECT_THAT(ours.step.classes, ElementsAre(::testing::Field(&ClassSmoothness::smoothness, 3),
                                             ::testing::Field(&ClassSmoothness::smoothness, 0.25)));

  EXPECT_THAT(ours.step.classes, ElementsAre(::testing::Field(&ClassSmoothness::anchor, 0.5),
                                             ::testing::Field(&ClassSmoothness::anchor, 0)));

  EXPECT_FALSE(baseline.geometry_uses_labels);
  EXPECT_EQ(MethodRulesOf("baseline", 0, {}).rounds, 1);
  EXPECT_EQ(baseline.data.semantic, 0);
  EXPECT_EQ(baseline.step.inter, 0);
  EXPECT_THAT(baseline.step.classes, IsEmpty());
  EXPECT_EQ(baseline.label.form, ours.label.form);

  EXPECT_TRUE(paper.geometry_uses_labels);
  EXPECT_EQ(MethodRulesOf("paper", 0, {}).rounds, 5);
  EXPECT_GT(paper.data.semantic, 0);
  EXPECT_GT(paper.step.inter, 0);
  EXPECT_EQ(paper.step.mixed, 0);
  EXPECT_GT(ours.data.contour, 0);
  EXPECT_EQ(baseline.data.contour, 0);
  EXPECT_EQ(paper.data.contour, 0);
  EXPECT_EQ(paper.label.prior_weight, 0.35);
  EXPECT_EQ(paper.label.smoothness_weight, 0.5);
  EXPECT_THAT(paper.step.classes, ElementsAre(::testing::Field(&ClassSmoothness::smoothness, 3),
                                              ::testing::Field(&ClassSmoothness::smoothness, 0.25)));
  EXPECT_EQ(paper.label.form, LabelOptions::Form::kPaper);

  for (const TileRefineOptions* other : {&baseline, &paper}) {  // same settings for a fair comparison
    EXPECT_EQ(other->data.window_px, ours.data.window_px);
    EXPECT_EQ(other->step.max_step_px, ours.step.max_step_px);
  }
  MethodSettings same;
  same.iterations = {4, 8, 8};  // of those that split faces once
  EXPECT_EQ(StepsOf("baseline", {}, 2), StepsOf("tessera", same, 2));
  EXPECT_EQ(StepsOf("paper", {}, 1), StepsOf("tessera", same, 1));
}

// The help prints these standards.
TEST(Methods, StandardSettingsEqualTheMethodsDefaults) {
  const TileRefineOptions ours = OptionsOf("tessera");
  MethodSettings standard;
  for (const auto& setting : RealSettings()) standard.*setting.value = setting.standard;
  for (const auto& setting : WholeSettings()) standard.*setting.value = setting.standard;
  for (const ListSetting& setting : ListSettings()) standard.*setting.value = setting.standard;
  for (const BoolSetting& setting : BoolSettings()) standard.*setting.value = setting.standard;
  const TileRefineOptions same = OptionsOf("tessera", standard);
  EXPECT_EQ(same.data.semantic, ours.data.semantic);
  EXPECT_EQ(same.step.thin_plate, ours.step.thin_plate);
  EXPECT_EQ(same.step.inter, ours.step.inter);
  EXPECT_EQ(same.data.contour, ours.data.contour);
  EXPECT_EQ(same.label.prior_weight, ours.label.prior_weight);
  EXPECT_EQ(same.label.smoothness_weight, ours.label.smoothness_weight);
  EXPECT_EQ(same.step.max_step_px, ours.step.max_step_px);
  EXPECT_EQ(same.data.window_px, ours.data.window_px);
  EXPECT_EQ(StepsOf("tessera", standard), StepsOf("tessera"));
  EXPECT_EQ(LabelsFirst("tessera", standard), LabelsFirst("tessera"));
}

// Forms show these defaults.
TEST(Methods, StatedDefaultsEqualUnsetSettings) {
  for (const char* const method : kMethods) {
    MethodSettings stated;
    for (const auto& setting : RealSettings()) {
      if (const auto text = MethodDefault(setting.name, method)) stated.*setting.value = std::stod(*text);
    }
    for (const auto& setting : WholeSettings()) {
      if (const auto text = MethodDefault(setting.name, method)) stated.*setting.value = std::stoi(*text);
    }
    for (const BoolSetting& setting : BoolSettings()) {
      if (const auto text = MethodDefault(setting.name, method)) stated.*setting.value = *text == "true";
    }
    const TileRefineOptions unset = OptionsOf(method), set = OptionsOf(method, stated);
    EXPECT_EQ(set.data.semantic, unset.data.semantic) << method;
    EXPECT_EQ(set.step.thin_plate, unset.step.thin_plate) << method;
    EXPECT_EQ(set.step.inter, unset.step.inter) << method;
    EXPECT_EQ(set.data.contour, unset.data.contour) << method;
    EXPECT_EQ(set.label.prior_weight, unset.label.prior_weight) << method;
    EXPECT_EQ(set.label.smoothness_weight, unset.label.smoothness_weight) << method;
    EXPECT_EQ(set.step.max_step_px, unset.step.max_step_px) << method;
    EXPECT_EQ(set.data.window_px, unset.data.window_px) << method;
    EXPECT_EQ(LabelsFirst(method, stated), LabelsFirst(method)) << method;
    EXPECT_EQ(MethodRulesOf(method, 0, stated).flips_edges, MethodRulesOf(method, 0, {}).flips_edges) << method;
  }
  EXPECT_EQ(MethodDefault("levels", "tessera"), "2,1,0");
  EXPECT_EQ(MethodDefault("iterations", "tessera"), "4,8,6");
  EXPECT_EQ(MethodDefault("iterations", "paper"), "4,8,8");
  EXPECT_EQ(MethodDefault("semantic", "baseline"), std::nullopt);
  EXPECT_EQ(MethodDefault("nonsense", "tessera"), std::nullopt);
}

TEST(Methods, SettingsOverrideTheMethod) {
  MethodSettings settings;
  settings.semantic = 11;
  settings.thin_plate = 12;
  settings.inter = 13;
  settings.contour = 14;
  settings.normal_prior = 15;
  settings.label_smoothness = 16;
  settings.max_step_px = 0.5;
  settings.window_px = 5;
  settings.labels_first = false;
  settings.levels = {1};
  settings.iterations = {7};
  const TileRefineOptions options = OptionsOf("paper", settings, 2);
  EXPECT_EQ(MethodRulesOf("paper", 2, settings).rounds, 2);
  EXPECT_FALSE(LabelsFirst("paper", settings));
  EXPECT_EQ(options.data.semantic, 11);
  EXPECT_EQ(options.step.thin_plate, 12);
  EXPECT_EQ(options.step.inter, 13);
  EXPECT_EQ(options.data.contour, 14);
  EXPECT_EQ(options.label.prior_weight, 15);
  EXPECT_EQ(options.label.smoothness_weight, 16);
  EXPECT_EQ(options.step.max_step_px, 0.5);
  EXPECT_EQ(options.data.window_px, 5);
  std::vector<std::array<int, 2>> steps = {{-1, -1}};
  for (const int round : {0, 1}) {
    steps.insert(steps.end(), 7, {1, round});
    steps.push_back({-1, round});
  }
  EXPECT_EQ(StepsOf("paper", settings, 2), steps);
}

// Labels are solved first if the method requires it, or if its geometry needs labels and the scene has none.
TEST(Methods, LabelsAreSolvedFirstIfNeeded) {
  const auto first = [](const std::string& method, const LabelTraits& traits) {
    return LabelsFirst(method, {}, traits);
  };
  const LabelTraits unlabelled = {.classes = 2, .has_likelihoods = true}, none = {.classes = 2, .has_labels = true};
  EXPECT_TRUE(first("tessera", kLabelled));
  EXPECT_FALSE(first("paper", kLabelled));
  EXPECT_TRUE(first("paper", unlabelled));
  EXPECT_FALSE(first("baseline", unlabelled));
  for (const char* method : kMethods) EXPECT_FALSE(first(method, none)) << "no likelihoods, so no labels";
}

TEST(Methods, InvalidMethodsAndSettingsAreRefused) {
  const Status unknown = MethodOptions({0, "magic", {}}, TwoClasses()).status();
  EXPECT_EQ(unknown.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(unknown.message()), HasSubstr("tessera, baseline, paper"));
  for (const int window_px : {4, 13}) {
    MethodSettings settings;
    settings.window_px = window_px;
    EXPECT_EQ(MethodOptions({0, "tessera", settings}, TwoClasses()).status().code(),
              absl::StatusCode::kInvalidArgument);
  }
  MethodSettings fewer;
  fewer.levels = {1, 0};
  fewer.iterations = {1};
  EXPECT_EQ(MethodOptions({0, "tessera", fewer}, TwoClasses()).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace tessera
