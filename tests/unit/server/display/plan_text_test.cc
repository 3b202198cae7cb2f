#include "server/display/plan_text.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <vector>

namespace tessera {
namespace {

// Cells of a square city under six cameras that look down on all of it.
Survey SmallCity() {
  Survey survey;
  survey.gsd_m = 0.1;
  survey.ground = MakeGroundPlane(survey.up, 8);
  survey.views.resize(6);
  for (SceneView& view : survey.views) {
    view.camera.intrinsics = {2000, 2000, 4000, 4000, 1000, 1000};
    view.camera.rotation_cam_from_world.diagonal() << 1, -1, -1;
    view.camera.translation_cam_from_world = {-40, 40, 400};
  }
  for (int y = 0; y < 10; ++y) {
    for (int x = 0; x < 10; ++x) {
      SurveyCell cell;
      cell.x = x;
      cell.y = y;
      cell.faces = 500 + 100 * x;
      cell.box_min = {8.0 * x, 8.0 * y, 0};
      cell.box_max = {8.0 * x + 8, 8.0 * y + 8, 10};
      cell.views = {0, 1, 2, 3, 4, 5};
      survey.faces += cell.faces;
      survey.cells.push_back(cell);
    }
  }
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      if (i != j) survey.pairs.push_back({i, j});
    }
  }
  survey.classes.resize(2);
  return survey;
}

TEST(QuoteTest, TotalsAreThoseOfAllTasks) {
  const Survey survey = SmallCity();
  const auto quote = MakeQuote({.tiles = 4}, survey);
  ASSERT_TRUE(quote.ok()) << quote.status();
  ASSERT_EQ(quote->tiles.size(), 4u);
  double seconds = quote->ingest.core_seconds + quote->split.core_seconds + quote->publish.core_seconds, faces = 0;
  int64_t stored = quote->ingest.stored_bytes + quote->split.stored_bytes + quote->publish.stored_bytes;
  for (const TileQuote& tile : quote->tiles) {
    for (const Prediction& task : {tile.cut, tile.crop, tile.measure, tile.solve, tile.mend}) {
      EXPECT_GT(task.core_seconds, 0);
      EXPECT_GT(task.stored_bytes, 0);
      seconds += task.core_seconds;
      stored += task.stored_bytes;
    }
    EXPECT_EQ(tile.refine.core_seconds, 0);
    faces += tile.work.core_faces;
    EXPECT_GT(tile.work.visible_faces, tile.work.core_faces);
    EXPECT_LE(tile.Total().peak_bytes, quote->peak_bytes);
  }
  EXPECT_DOUBLE_EQ(quote->core_seconds, seconds);
  EXPECT_EQ(quote->stored_bytes, stored);
  EXPECT_EQ(faces, static_cast<double>(survey.faces));
  EXPECT_DOUBLE_EQ(quote->area_m2, 6400);
}

TEST(QuoteTest, TheOnlyTileIsRefinedByOneTask) {
  const auto quote = MakeQuote({.tiles = 1}, SmallCity());
  ASSERT_TRUE(quote.ok()) << quote.status();
  const TileQuote& tile = quote->tiles.at(0);
  EXPECT_GT(tile.refine.core_seconds, 0);
  EXPECT_EQ(tile.measure.core_seconds + tile.solve.core_seconds + tile.mend.core_seconds, 0);
  EXPECT_EQ(tile.work.visible_faces, tile.work.core_faces);
}

TEST(QuoteTest, WallTimeUsesListScheduling) {
  const auto quote = MakeQuote({.tiles = 4}, SmallCity());
  ASSERT_TRUE(quote.ok());
  const double one = WallSeconds(*quote, 1, 1), two = WallSeconds(*quote, 2, 1), many = WallSeconds(*quote, 100, 1);
  EXPECT_NEAR(one, quote->core_seconds, 1e-9 * one);
  EXPECT_LT(two, 0.75 * one);
  EXPECT_GE(two, 0.5 * one);
  EXPECT_DOUBLE_EQ(many, WallSeconds(*quote, 4, 1)) << "no more workers than tiles are of use";
  EXPECT_DOUBLE_EQ(WallSeconds(*quote, 2, 4), two / 4);
}

TEST(PlanTextTest, TableAndJsonAgree) {
  const auto quote = MakeQuote({.tiles = 3}, SmallCity());
  ASSERT_TRUE(quote.ok());
  PlanTerms terms;
  terms.workers = 2;
  terms.price_per_core_hour = 3600;  // a unit a core-second
  const std::string table = PlanTable(*quote, terms);
  EXPECT_NE(table.find("tiles: 3"), std::string::npos) << table;
  EXPECT_NE(table.find("time with 2 workers of 1 core"), std::string::npos) << table;
  const auto json = nlohmann::json::parse(PlanJson(*quote, terms));
  ASSERT_EQ(json["tiles"].size(), 3u);
  for (const char* kind : {"cut", "crop", "measure", "solve", "mend"}) EXPECT_TRUE(json["tiles"][0].contains(kind));
  EXPECT_DOUBLE_EQ(json["price"]["predicted"], json["core_seconds"]["predicted"]);
  EXPECT_LT(json["core_seconds"]["low"], json["core_seconds"]["predicted"]);
  EXPECT_GT(json["core_seconds"]["high"], json["core_seconds"]["predicted"]);
  char price[32];
  std::snprintf(price, sizeof(price), "price: %.2f (", json["price"]["predicted"].get<double>());
  EXPECT_NE(table.find(price), std::string::npos) << table;
}

// Every element that is opened is closed, in order, and text has no stray markup.
void ExpectWellFormed(const std::string& xml) {
  std::vector<std::string> open;
  for (size_t at = xml.find('<'); at != std::string::npos; at = xml.find('<', at + 1)) {
    const size_t end = xml.find('>', at);
    ASSERT_NE(end, std::string::npos);
    const std::string tag = xml.substr(at + 1, end - at - 1);
    ASSERT_EQ(tag.find('<'), std::string::npos) << tag;
    EXPECT_EQ(std::count(tag.begin(), tag.end(), '"') % 2, 0) << tag;
    if (tag[0] == '?' || tag.back() == '/') continue;
    if (tag[0] != '/') {
      open.push_back(tag.substr(0, tag.find(' ')));
      continue;
    }
    ASSERT_FALSE(open.empty());
    EXPECT_EQ(open.back(), tag.substr(1));
    open.pop_back();
  }
  EXPECT_TRUE(open.empty());
}

TEST(PlanTextTest, TheMapHasEveryTileAndCamera) {
  const Survey survey = SmallCity();
  const auto quote = MakeQuote({.tiles = 5}, survey);
  ASSERT_TRUE(quote.ok());
  const std::string map = PlanMap(*quote, survey);
  ExpectWellFormed(map);
  const auto count = [&](const std::string& word) {
    int found = 0;
    for (size_t at = map.find(word); at != std::string::npos; at = map.find(word, at + 1)) ++found;
    return found;
  };
  EXPECT_EQ(count("<rect "), 5);
  EXPECT_EQ(count("<title>tile "), 5);
  EXPECT_EQ(count("<circle "), 6);
  EXPECT_EQ(map.find("nan"), std::string::npos);
  EXPECT_EQ(map.find("inf"), std::string::npos);
}

}  // namespace
}  // namespace tessera
