#include "worker/tile/methods.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

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
  const auto options = MethodOptions({rounds, method, settings}, TwoClasses(), kLabelled);
  EXPECT_TRUE(options.ok()) << options.status();
  return options.ok() ? *options : TileRefineOptions();
}

TEST(Methods, EachHasItsTerms) {
  const TileRefineOptions ours = OptionsOf("tessera"), baseline = OptionsOf("baseline"), paper = OptionsOf("paper");
  EXPECT_TRUE(ours.geometry_knows_labels);
  EXPECT_TRUE(ours.labels_first);
  EXPECT_EQ(ours.geometry.semantic, 0);
  EXPECT_EQ(ours.geometry.inter, 0);
  EXPECT_EQ(ours.label.form, LabelOptions::Form::kTessera);
  EXPECT_THAT(ours.geometry.classes, ElementsAre(::testing::Field(&ClassSmoothness::smoothness, 3),
                                                 ::testing::Field(&ClassSmoothness::smoothness, 0.25)));

  EXPECT_THAT(ours.geometry.classes,
              ElementsAre(::testing::Field(&ClassSmoothness::keep, 0.5), ::testing::Field(&ClassSmoothness::keep, 0)));

  EXPECT_FALSE(baseline.geometry_knows_labels);
  EXPECT_EQ(baseline.rounds, 1);
  EXPECT_EQ(baseline.geometry.semantic, 0);
  EXPECT_EQ(baseline.geometry.inter, 0);
  EXPECT_THAT(baseline.geometry.classes, IsEmpty());
  EXPECT_EQ(baseline.label.form, ours.label.form);

  EXPECT_TRUE(paper.geometry_knows_labels);
  EXPECT_EQ(paper.rounds, 5);
  EXPECT_GT(paper.geometry.semantic, 0);
  EXPECT_GT(paper.geometry.inter, 0);
  EXPECT_EQ(paper.geometry.mixed, 0);
  EXPECT_GT(ours.geometry.contour, 0);
  EXPECT_EQ(baseline.geometry.contour, 0);
  EXPECT_EQ(paper.geometry.contour, 0);
  EXPECT_EQ(paper.label.prior_weight, 0.35);
  EXPECT_EQ(paper.label.smoothness_weight, 0.5);
  EXPECT_THAT(paper.geometry.classes, ElementsAre(::testing::Field(&ClassSmoothness::smoothness, 3),
                                                  ::testing::Field(&ClassSmoothness::smoothness, 0.25)));
  EXPECT_EQ(paper.label.form, LabelOptions::Form::kPaper);

  for (const TileRefineOptions* other : {&baseline, &paper}) {  // compared on even terms
    EXPECT_EQ(other->geometry.levels, ours.geometry.levels);
    EXPECT_EQ(other->geometry.window_px, ours.geometry.window_px);
    EXPECT_EQ(other->geometry.max_step_px, ours.geometry.max_step_px);
    EXPECT_EQ(other->geometry.partners, ours.geometry.partners);
  }
}

// What the help says is what happens without settings.
TEST(Methods, StandardsAreThoseOfTheMethod) {
  const TileRefineOptions ours = OptionsOf("tessera");
  MethodSettings standard;
  for (const auto& setting : RealSettings()) standard.*setting.value = setting.standard;
  for (const auto& setting : WholeSettings()) standard.*setting.value = setting.standard;
  for (const ListSetting& setting : ListSettings()) standard.*setting.value = setting.standard;
  for (const BoolSetting& setting : BoolSettings()) standard.*setting.value = setting.standard;
  const TileRefineOptions same = OptionsOf("tessera", standard);
  EXPECT_EQ(same.geometry.semantic, ours.geometry.semantic);
  EXPECT_EQ(same.geometry.thin_plate, ours.geometry.thin_plate);
  EXPECT_EQ(same.geometry.inter, ours.geometry.inter);
  EXPECT_EQ(same.geometry.contour, ours.geometry.contour);
  EXPECT_EQ(same.label.prior_weight, ours.label.prior_weight);
  EXPECT_EQ(same.label.smoothness_weight, ours.label.smoothness_weight);
  EXPECT_EQ(same.geometry.max_step_px, ours.geometry.max_step_px);
  EXPECT_EQ(same.geometry.window_px, ours.geometry.window_px);
  EXPECT_EQ(same.geometry.partners, ours.geometry.partners);
  EXPECT_EQ(same.geometry.levels, ours.geometry.levels);
  EXPECT_EQ(same.geometry.iterations, ours.geometry.iterations);
  EXPECT_EQ(same.labels_first, ours.labels_first);
}

TEST(Methods, SettingsGoOverThem) {
  MethodSettings settings;
  settings.semantic = 11;
  settings.thin_plate = 12;
  settings.inter = 13;
  settings.contour = 14;
  settings.normal_prior = 15;
  settings.label_smoothness = 16;
  settings.max_step_px = 0.5;
  settings.window_px = 5;
  settings.partners = 9;
  settings.labels_first = false;
  settings.levels = {1};
  settings.iterations = {7};
  const TileRefineOptions options = OptionsOf("paper", settings, 2);
  EXPECT_EQ(options.rounds, 2);
  EXPECT_FALSE(options.labels_first);
  EXPECT_EQ(options.geometry.semantic, 11);
  EXPECT_EQ(options.geometry.thin_plate, 12);
  EXPECT_EQ(options.geometry.inter, 13);
  EXPECT_EQ(options.geometry.contour, 14);
  EXPECT_EQ(options.label.prior_weight, 15);
  EXPECT_EQ(options.label.smoothness_weight, 16);
  EXPECT_EQ(options.geometry.max_step_px, 0.5);
  EXPECT_EQ(options.geometry.window_px, 5);
  EXPECT_EQ(options.geometry.partners, 9);
  EXPECT_THAT(options.geometry.levels, ElementsAre(1));
  EXPECT_THAT(options.geometry.iterations, ElementsAre(7));
}

// Labels are solved before the geometry where the method wants it, or where its geometry needs them and there are none.
TEST(Methods, LabelsComeFirstWhereTheyAreNeeded) {
  const auto first = [](const std::string& method, const LabelTraits& traits) {
    return MethodOptions({0, method, {}}, TwoClasses(), traits)->labels_first;
  };
  const LabelTraits unlabelled = {.classes = 2, .has_likelihoods = true}, none = {.classes = 2, .has_labels = true};
  EXPECT_TRUE(first("tessera", kLabelled));
  EXPECT_FALSE(first("paper", kLabelled));
  EXPECT_TRUE(first("paper", unlabelled));
  EXPECT_FALSE(first("baseline", unlabelled));
  for (const char* method : kMethods) EXPECT_FALSE(first(method, none)) << "nothing to learn labels from";
}

TEST(Methods, WrongOnesAreRefused) {
  const Status unknown = MethodOptions({0, "magic", {}}, TwoClasses(), kLabelled).status();
  EXPECT_EQ(unknown.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(unknown.message()), HasSubstr("tessera, baseline, paper"));
  MethodSettings settings;
  settings.window_px = 13;
  EXPECT_FALSE(MethodOptions({0, "tessera", settings}, TwoClasses(), kLabelled).ok());
}

}  // namespace
}  // namespace tessera
