#include "worker/city/view_choice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tessera {
namespace {

using testing::ElementsAre;

SampleObservation Seen(int32_t view, int direction, double pixels, double px_per_m = 10) {
  return {view, direction, pixels, px_per_m};
}

TEST(ViewChoice, EachDirectionKeepsItsViews) {
  const std::vector<std::vector<SampleObservation>> samples = {
      {Seen(0, 0, 100), Seen(1, 0, 90), Seen(2, 0, 80), Seen(7, 3, 2), Seen(8, 3, 1)}};
  EXPECT_THAT(ChooseBalanced(samples, {.views_per_direction = 2}), ElementsAre(0, 1, 7, 8));
  EXPECT_THAT(ChooseBalanced(samples, {.views_per_direction = 1}), ElementsAre(0, 7));
}

TEST(ViewChoice, ViewBelongsToItsDominantDirection) {
  const std::vector<std::vector<SampleObservation>> samples = {{Seen(0, 1, 10), Seen(1, 1, 9)}, {Seen(1, 2, 30)}};
  EXPECT_THAT(ChooseBalanced(samples, {.views_per_direction = 1}), ElementsAre(0, 1));
}

TEST(ViewChoice, UncoveredSamplesHavePriority) {
  const std::vector<std::vector<SampleObservation>> samples = {{Seen(0, 0, 10), Seen(1, 0, 9)}, {Seen(2, 0, 6)}};
  EXPECT_THAT(ChooseBalanced(samples, {.views_per_direction = 2}), ElementsAre(0, 2));
}

TEST(ViewChoice, ViewsBelowTheMinimumShareAreDropped) {
  const std::vector<std::vector<SampleObservation>> samples = {
      {Seen(0, 0, 100), Seen(1, 0, 4), Seen(2, 0, 6), Seen(3, 0, 0)}};
  EXPECT_THAT(ChooseBalanced(samples, {}), ElementsAre(0, 2));
  EXPECT_TRUE(ChooseBalanced({}, {}).empty());
}

TEST(WeighByResolution, ReducesCoarseViewsDownToZero) {
  std::vector<SampleObservation> sample = {Seen(0, 0, 9, 30), Seen(1, 0, 9, 30), Seen(2, 0, 9, 15), Seen(3, 0, 9, 10),
                                           Seen(4, 0, 9, 5)};
  WeighByResolution({}, &sample);
  EXPECT_DOUBLE_EQ(sample[0].pixels, 9);
  EXPECT_DOUBLE_EQ(sample[1].pixels, 9);
  EXPECT_DOUBLE_EQ(sample[2].pixels, 4.5);
  EXPECT_DOUBLE_EQ(sample[3].pixels, 0);
  EXPECT_DOUBLE_EQ(sample[4].pixels, 0);
  EXPECT_THAT(ChooseBalanced({sample}, {}), ElementsAre(0, 1, 2));
}

// The close-up has only the coarser views as partners.
TEST(WeighByResolution, OneCloseUpDoesNotExcludeItsPartners) {
  std::vector<SampleObservation> sample = {Seen(0, 0, 900, 100), Seen(1, 0, 90, 10), Seen(2, 0, 80, 9)};
  WeighByResolution({}, &sample);
  EXPECT_DOUBLE_EQ(sample[0].pixels, 900);
  EXPECT_DOUBLE_EQ(sample[1].pixels, 90);
  EXPECT_GT(sample[2].pixels, 70);
  std::vector<SampleObservation> alone = {Seen(0, 0, 5)};
  WeighByResolution({}, &alone);
  EXPECT_DOUBLE_EQ(alone[0].pixels, 5);
}

}  // namespace
}  // namespace tessera
