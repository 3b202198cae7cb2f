// Surveys of imported scenes: projected coordinates, and the source.
#include <gtest/gtest.h>

#include "common/job/ground.h"
#include "common/job/survey.h"

namespace tessera {
namespace {

Survey SmallSurvey(const Crs& crs) {
  Survey s;
  s.gsd_m = 0.1;
  s.ground = MakeGroundPlane(s.up, 2);
  s.cells = {{0, 0, 1, 0, 0, {0, 0, 0}, {1, 1, 1}, {}}};
  s.classes.resize(1);
  s.borders = BorderTrusts(1);
  s.crs = crs;
  return s;
}

TEST(SurveySource, ProjectedCoordinatesAreKept) {
  Crs crs;
  crs.kind = Crs::Kind::kProjected;
  crs.epsg = 2154;
  crs.vertical_epsg = 5720;
  crs.height_m = 44.5;
  const StatusOr<Survey> parsed = ParseSurvey(SurveyToJson(SmallSurvey(crs)));
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->crs, crs);
}

// Stored surveys have no codes; those of other systems are written as before.
TEST(SurveySource, OtherSystemsAreWrittenAsBefore) {
  Crs crs;
  crs.kind = Crs::Kind::kUtm;
  crs.zone = 32;
  const std::string json = SurveyToJson(SmallSurvey(crs));
  EXPECT_NE(json.find(R"("crs":{"height_m":0.0,"kind":2,"lat_rad":0.0,"lon_rad":0.0,"north":true,"zone":32})"),
            std::string::npos)
      << json;
  EXPECT_EQ(json.find("\"source\""), std::string::npos);
  const StatusOr<Survey> parsed = ParseSurvey(json);
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->crs, crs);
}

TEST(SurveySource, SourceIsKeptAndChangesNoResult) {
  Survey survey = SmallSurvey({});
  const std::string plain = SurveyToJson(WithoutNames(survey));
  survey.source = R"({"crs":"EPSG:2154","offset":[1.0,2.0,3.0],"tiles":["a"]})";
  const StatusOr<Survey> parsed = ParseSurvey(SurveyToJson(survey));
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->source, survey.source);
  EXPECT_EQ(SurveyToJson(WithoutNames(survey)), plain);
}

}  // namespace
}  // namespace tessera
