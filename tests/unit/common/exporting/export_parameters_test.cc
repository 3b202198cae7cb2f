#include "common/exporting/export_parameters.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "common/exporting/survey_sheets.h"

namespace tessera {
namespace {

using testing::ElementsAre;

ExportParameters SomeParameters() {
  ExportParameters p;
  p.stage = ExportStage::kSheet;
  p.format = "obj";
  p.options = R"({"formats":["obj"]})";
  p.sheet = {3, -1};
  p.sheets = {{2, -2}, {3, 0}};
  p.start = p.views = p.colored = true;
  p.set_aside = {{3, -1}};
  return p;
}

TEST(ExportParametersTest, RoundTrip) {
  for (const ExportStage stage : {ExportStage::kSplit, ExportStage::kColor, ExportStage::kSheet, ExportStage::kJoin}) {
    ExportParameters p = SomeParameters();
    p.stage = stage;
    p.changes = stage == ExportStage::kJoin;
    const std::string json = ToJson(p);
    const auto back = ParseExportParameters(json);
    ASSERT_TRUE(back.ok()) << back.status() << json;
    EXPECT_EQ(back->stage, stage);
    EXPECT_EQ(back->sheets, p.sheets);
    EXPECT_EQ(back->changes, p.changes);
    EXPECT_EQ(ToJson(*back), json);
  }
  EXPECT_EQ(ParseExportParameters(ToJson(SomeParameters()))->sheet, (SheetId{3, -1}));
}

// Parameters come from records and leases.
TEST(ExportParametersTest, OtherFormsAreRefused) {
  const std::string good = ToJson(SomeParameters());
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string json = good;
    json.replace(json.find(from), from.size(), to);
    return json;
  };
  for (const std::string& bad :
       {std::string(), std::string("[]"), std::string(100'000, '['), with("\"stage\":\"sheet\"", "\"stage\":\"merge\""),
        with("[3,-1]", "[3]"), with("[3,-1]", "[3,-1,0]"), with("[3,-1]", "[3.5,-1]"),
        with("[3,-1]", "[3000000000,-1]"), with("[3,-1]", "[\"3\",-1]"), with("\"obj\"", "7"), with("{", "{ "),
        with("{", "{\"other\":1,")}) {
    EXPECT_EQ(ParseExportParameters(bad).status().code(), absl::StatusCode::kInvalidArgument) << bad.substr(0, 200);
  }
}

TEST(ExportParametersTest, FileNamesDiffer) {
  const SheetId id{3, -1};
  EXPECT_EQ(SheetFileName(id), "sheets/3_-1.arrays");
  EXPECT_EQ(StartSheetFileName(id), "start/3_-1.arrays");
  EXPECT_EQ(ColoredSheetFileName(id), "colored/3_-1.arrays");
  EXPECT_EQ(PartFileName("3dtiles", id), "parts/3dtiles/3_-1.arrays");
  EXPECT_EQ(SheetArchiveName("3dtiles", id), "export/3dtiles/3_-1.zip");
  EXPECT_THAT(*ParseSheetList(SheetListToJson({{3, -1}, {0, 2}})), ElementsAre(SheetId{3, -1}, SheetId{0, 2}));
  EXPECT_FALSE(ParseSheetList("{}x").ok());
  for (const std::string& name :
       {SheetFileName(id), StartSheetFileName(id), ColoredSheetFileName(id), PartFileName("3dtiles", id)}) {
    EXPECT_TRUE(IsPassedOn(name)) << name;
  }
  for (const std::string& name : {SheetViewsFileName(id), SheetArchiveName("3dtiles", id), std::string("mesh.ply"),
                                  std::string("sheets"), std::string(kExportSceneFile)}) {
    EXPECT_FALSE(IsPassedOn(name)) << name;
  }
}

TEST(SurveySheetsTest, CellsAreGroupedAndWithdrawnViewsLeftOut) {
  Survey survey;
  survey.views.resize(4);
  survey.views[2].withdrawn = true;
  const auto add = [&](int x, int y, int64_t faces, std::vector<int32_t> views) {
    SurveyCell& cell = survey.cells.emplace_back();
    cell.x = x;
    cell.y = y;
    cell.faces = faces;
    cell.views = std::move(views);
  };
  add(-1, 0, 5, {0});
  add(0, 0, 7, {1, 2});
  add(15, 15, 11, {3});
  add(0, 16, 13, {});
  const std::vector<SurveySheet> sheets = SheetsOf(survey);
  ASSERT_EQ(sheets.size(), 3u);
  EXPECT_EQ(sheets[0].id, (SheetId{-1, 0}));
  EXPECT_EQ(sheets[1].id, (SheetId{0, 0}));
  EXPECT_EQ(sheets[1].faces, 18);
  EXPECT_THAT(sheets[1].views, ElementsAre(1, 3));
  EXPECT_EQ(sheets[2].id, (SheetId{0, 1}));

  const auto views = ParseSheetViews(SheetViewsToJson(survey, sheets[1]));
  ASSERT_TRUE(views.ok()) << views.status();
  EXPECT_THAT(views->ids, ElementsAre(1, 3));
  EXPECT_EQ(views->views.size(), 2u);
  EXPECT_FALSE(ParseSheetViews(R"({"ids":[1],"views":"[]"})").ok());
  EXPECT_FALSE(ParseSheetViews("[").ok());
}

TEST(SurveySheetsTest, NamesOfViewsAreReadAsTheyWereWritten) {
  Survey survey;
  EXPECT_TRUE(ParseViewNames(ViewNamesToJson(survey))->empty());
  survey.views.resize(3);
  for (const auto& [x, views] : std::map<int, std::vector<int32_t>>{{-1, {0, 2}}, {0, {}}, {16, {1}}}) {
    SurveyCell& cell = survey.cells.emplace_back();
    cell.x = x;
    cell.views = views;
  }
  EXPECT_EQ(ViewNamesToJson(survey), "{}") << "views without names";
  survey.views[0].name = "a b";
  survey.views[1].name = "<img src=x>";
  survey.views[2].name = "c";
  const StatusOr<ViewNamesOfSheets> names = ParseViewNames(ViewNamesToJson(survey));
  ASSERT_TRUE(names.ok()) << names.status();
  ASSERT_EQ(names->size(), 3u);
  EXPECT_THAT(names->at({-1, 0}), ElementsAre("a b", "c"));
  EXPECT_TRUE(names->at({0, 0}).empty());
  EXPECT_THAT(names->at({1, 0}), ElementsAre("<img src=x>"));
  for (const char* damaged : {"[", "{\"sheets\":3}", R"({"names":["a"],"sheets":{"0_0":"1"}})",
                              R"({"names":["a"],"sheets":{"0":"0"}})", R"({"names":["a"],"sheets":{"0_0":[0]}})"}) {
    EXPECT_EQ(ParseViewNames(damaged).status().code(), absl::StatusCode::kInvalidArgument) << damaged;
  }
}

// What changes without changing a picture does not change a sheet's views.
TEST(SurveySheetsTest, ViewsDependOnPhotographsAlone) {
  Survey survey;
  survey.views.resize(1);
  survey.views[0].image_path = "views/000000.image";
  survey.views[0].image_content = "pixels";
  const SurveySheet sheet = {{0, 0}, 1, {0}};
  const std::string before = SheetViewsToJson(survey, sheet);
  survey.views[0].likelihood_path = "views/000000.likelihoods";
  survey.views[0].likelihood_content = "other";
  EXPECT_EQ(SheetViewsToJson(survey, sheet), before);
  survey.views[0].image_content = "other pixels";
  EXPECT_NE(SheetViewsToJson(survey, sheet), before);
}

}  // namespace
}  // namespace tessera
