// View selection of cells after views were added or withdrawn.
#include <gtest/gtest.h>

#include "tests/unit/worker/tile/tiny_city.h"
#include "worker/city/update_survey.h"

namespace tessera {
namespace {

// The city with a second flight one year later at the poses of the first.
TinyCity WithSecondFlight(ViewChanges* changes) {
  TinyCity tiny = MakeTinyCity();
  Survey& survey = tiny.survey;
  survey.flights = {{"first", "2026-05-01"}, {"second", "2027-05-01"}};
  const size_t known = survey.views.size();
  changes->changed.assign(known, 0);
  for (size_t v = 0; v < known; ++v) survey.views[v].flight = 0;
  for (size_t i = 0; i < 2 * known; ++i) {
    survey.views.push_back(survey.views[i % known]);
    survey.views.back().flight = 1;
    changes->changed.push_back(1);
  }
  return tiny;
}

Status Choose(const TinyCity& tiny, const ViewChanges& changes, bool all_epochs, Survey* survey) {
  return UpdateViewSelection(tiny.city, changes, all_epochs, CellViewOptions(), PairOptions(), {}, survey);
}

TEST(UpdateViewSelection, UnchangedViewsKeepTheSelection) {
  TinyCity tiny = MakeTinyCity();
  const std::string before = SurveyToJson(tiny.survey);
  ViewChanges changes;
  changes.changed.assign(tiny.survey.views.size(), 0);
  ASSERT_TRUE(Choose(tiny, changes, false, &tiny.survey).ok());
  EXPECT_EQ(SurveyToJson(tiny.survey), before);
}

TEST(UpdateViewSelection, WithdrawnViewIsRemovedFromItsCellsAndPairsOnly) {
  TinyCity tiny = MakeTinyCity();
  const Survey before = tiny.survey;
  const int32_t gone = before.cells[0].views.at(0);
  ViewChanges changes;
  changes.changed.assign(before.views.size(), 0);
  changes.changed[gone] = 1;
  tiny.survey.views[gone].withdrawn = true;
  ASSERT_TRUE(Choose(tiny, changes, false, &tiny.survey).ok());
  size_t stayed = 0;
  for (size_t c = 0; c < before.cells.size(); ++c) {
    const std::vector<int32_t>&was = before.cells[c].views, &is = tiny.survey.cells[c].views;
    EXPECT_FALSE(std::binary_search(is.begin(), is.end(), gone));
    if (std::binary_search(was.begin(), was.end(), gone)) continue;
    EXPECT_EQ(is, was);
    ++stayed;
  }
  EXPECT_LT(stayed, before.cells.size());
  for (const auto& pair : tiny.survey.pairs) {
    EXPECT_NE(pair[0], gone);
    EXPECT_NE(pair[1], gone);
  }
  for (const auto& pair : before.pairs) {
    if (pair[0] == gone || pair[1] == gone) continue;
    EXPECT_TRUE(std::binary_search(tiny.survey.pairs.begin(), tiny.survey.pairs.end(), pair)) << "others stay";
  }
}

TEST(UpdateViewSelection, NewestFlightIsPreferredWhereItCoversEnough) {
  ViewChanges changes;
  const TinyCity tiny = WithSecondFlight(&changes);
  const auto old_views = [&](bool all_epochs) {
    Survey survey = tiny.survey;
    EXPECT_TRUE(Choose(tiny, changes, all_epochs, &survey).ok());
    int64_t old = 0;
    for (const SurveyCell& cell : survey.cells) {
      old += std::count_if(cell.views.begin(), cell.views.end(), [&](int32_t v) { return !changes.changed[v]; });
    }
    return old;
  };
  EXPECT_EQ(old_views(false), 0) << "the second flight has the poses of the first";
  EXPECT_GT(old_views(true), 0);
}

TEST(UpdateViewSelection, NewViewsHavePartnersOfTheirOwnEpoch) {
  ViewChanges changes;
  TinyCity tiny = WithSecondFlight(&changes);
  PairOptions pairs;
  pairs.partners = 1;
  pairs.min_angle_rad = 0;  // also allows pairs of views with equal poses
  const auto without_new_partner = [&](bool all_epochs) {
    Survey survey = tiny.survey;
    survey.pairs.clear();
    EXPECT_TRUE(UpdateViewSelection(tiny.city, changes, all_epochs, CellViewOptions(), pairs, {}, &survey).ok());
    std::vector<uint8_t> has(survey.views.size(), 0);
    for (const auto& [a, b] : survey.pairs) has[a] |= changes.changed[a] && changes.changed[b];
    int without = 0;
    for (size_t v = 0; v < has.size(); ++v) without += changes.changed[v] && !has[v];
    return without;
  };
  EXPECT_EQ(without_new_partner(false), 0);
  EXPECT_GT(without_new_partner(true), 0) << "its only partner is an old one";
}

TEST(UpdateViewSelection, DatesDetermineTheNewestFlight) {
  ViewChanges changes;
  TinyCity tiny = WithSecondFlight(&changes);
  const auto new_is_preferred = [&](const std::string& first, const std::string& second) {
    Survey survey = tiny.survey;
    survey.flights = {{"first", first}, {"second", second}};
    EXPECT_TRUE(Choose(tiny, changes, false, &survey).ok());
    return std::all_of(survey.cells.begin(), survey.cells.end(), [&](const SurveyCell& cell) {
      return std::all_of(cell.views.begin(), cell.views.end(), [&](int32_t v) { return changes.changed[v] != 0; });
    });
  };
  EXPECT_TRUE(new_is_preferred("2026-05-01", ""));
  EXPECT_TRUE(new_is_preferred("", ""));
  EXPECT_FALSE(new_is_preferred("2026-05-01", "2025-05-01")) << "an older flight, added later";
  EXPECT_FALSE(new_is_preferred("2026-05-01", "2026-05-01")) << "flights of the same day are one epoch";
}

TEST(UpdateViewSelection, AllCellsChangedGivesTheSelectionOfIngest) {
  ViewChanges changes;
  const TinyCity tiny = WithSecondFlight(&changes);
  Survey updated = tiny.survey, whole = tiny.survey;
  ASSERT_TRUE(Choose(tiny, changes, true, &updated).ok());
  ASSERT_TRUE(ChooseViews(tiny.mesh, tiny.city, {}, {}, testing::TempDir(), &whole).ok());
  size_t same = 0;
  for (size_t c = 0; c < whole.cells.size(); ++c) {
    const bool changed = std::any_of(whole.cells[c].views.begin(), whole.cells[c].views.end(),
                                     [&](int32_t v) { return changes.changed[v] != 0; });
    if (!changed) continue;
    EXPECT_EQ(updated.cells[c].views, whole.cells[c].views) << c;
    ++same;
  }
  EXPECT_GT(same, whole.cells.size() / 2);
}

}  // namespace
}  // namespace tessera
