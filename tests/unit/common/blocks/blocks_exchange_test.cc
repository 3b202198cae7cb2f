#include "common/blocks/blocks_exchange/blocks_exchange.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "common/storage/files.h"
#include "tests/support/blocks/expect_block_near.h"
#include "tests/support/blocks/make_zip.h"
#include "tests/support/blocks/truth_block.h"
#include "tests/support/blocks/write_blocks_exchange.h"

namespace tessera {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr const char* kExchangeAxes[8][2] = {{"Right", "Down"}, {"Right", "Up"},  {"Left", "Down"}, {"Left", "Up"},
                                             {"Down", "Right"}, {"Down", "Left"}, {"Up", "Right"},  {"Up", "Left"}};

// A block whose images are in the order of their cameras, as in the file. `lens`: with the coefficients of all cameras.
ImportedBlock ExchangeTruth(const LensModel& lens = {}, double aspect_ratio = 1,
                            const Eigen::Vector3d& centre = {652000, 6863000, 80}) {
  ImportedBlock truth = MakeTruthBlock({.centre = centre});
  DistortTruth(lens, aspect_ratio, &truth);
  std::vector<int> order(truth.images.size()), place(truth.images.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return truth.images[a].camera < truth.images[b].camera; });
  std::vector<BlockImage> images;
  for (size_t i = 0; i < order.size(); ++i) {
    images.push_back(truth.images[order[i]]);
    place[order[i]] = static_cast<int>(i);
  }
  truth.images = images;
  for (BlockTiePoint& point : truth.points) {
    for (BlockObservation& seen : point.observations) seen.image = place[seen.image];
  }
  return truth;
}

LensModel ExchangeLens() {
  LensModel lens;
  lens.kind = LensModel::Kind::kBrown;
  lens.coefficients[0] = -0.08, lens.coefficients[1] = 0.05, lens.coefficients[4] = -0.02;
  lens.coefficients[2] = 0.0009, lens.coefficients[3] = -0.0006, lens.coefficients[6] = 0.7;
  return lens;
}

struct ExchangeResult {
  ImportedBlock block;
  Faults faults;
  Warnings warnings;
  std::string Message() const { return std::string(faults.ToStatus().message()); }
};

ExchangeResult ParseExchange(const std::string& text, int component = -1) {
  ExchangeResult result;
  const ExchangeLoader load = [](const std::string& path) { return absl::NotFoundError(path); };
  result.block = ParseBlocksExchange(text, "b.xml", load, {component}, &result.faults, &result.warnings);
  return result;
}

ImportedBlock ExpectExchange(const std::string& text) {
  ExchangeResult result = ParseExchange(text);
  EXPECT_EQ(result.Message(), "");
  EXPECT_THAT(result.warnings, IsEmpty());
  return result.block;
}

TEST(BlocksExchange, ReadsTheEightOrientationsAsMatrixAndAsAngles) {
  const ImportedBlock truth = ExchangeTruth(ExchangeLens());
  for (const auto& [x_axis, y_axis] : kExchangeAxes) {
    for (const bool angles : {false, true}) {
      SCOPED_TRACE(absl::StrCat("X", x_axis, "Y", y_axis, angles ? " angles" : ""));
      const ExchangeWriteOptions options{.x_axis = x_axis, .y_axis = y_axis, .angles = angles};
      const ImportedBlock block = ExpectExchange(WriteBlocksExchange(truth, options));
      ExpectBlockNear(block, truth);
      EXPECT_EQ(block.crs, "EPSG:2154");
      EXPECT_EQ(block.version, "3.2");
      EXPECT_EQ(block.images[0].path, truth.images[0].path);
      EXPECT_THAT(block.left_out, ElementsAre(HasSubstr("9 positions or rotations of GPS and IMU")));
    }
  }
}

TEST(BlocksExchange, ReadsMillimetresAlongTheAxes) {
  const ImportedBlock truth = ExchangeTruth(ExchangeLens());
  for (const auto& [x_axis, y_axis] : kExchangeAxes) {
    SCOPED_TRACE(absl::StrCat("X", x_axis, "Y", y_axis));
    const ExchangeWriteOptions options{.x_axis = x_axis, .y_axis = y_axis, .millimetres = true};
    ExpectBlockNear(ExpectExchange(WriteBlocksExchange(truth, options)), truth);
  }
}

TEST(BlocksExchange, ReadsPixelsThatAreNotSquareAndUndistortedCameras) {
  ExpectBlockNear(ExpectExchange(WriteBlocksExchange(ExchangeTruth({}, 1.0004), {})), ExchangeTruth({}, 1.0004));
  ImportedBlock block = ExpectExchange(WriteBlocksExchange(ExchangeTruth({}, 1 / 1.0004), {}));
  ASSERT_THAT(block.readings, testing::SizeIs(1));
  block.readings[0].apply(&block);
  EXPECT_NEAR(block.cameras[0].lens.pinhole.fy, block.cameras[0].lens.pinhole.fx * 1.0004, 1e-6);
  EXPECT_EQ(block.cameras[0].lens.kind, LensModel::Kind::kPinhole);
}

TEST(BlocksExchange, OffersTheOtherOrderOfP1AndP2) {
  const ImportedBlock truth = ExchangeTruth(ExchangeLens());
  ImportedBlock block = ExpectExchange(WriteBlocksExchange(truth, {.exchanged_p = true}));
  EXPECT_GT(LargestResidual_px(block, block.points), 0.5);
  ASSERT_THAT(block.readings, testing::SizeIs(1));
  block.readings[0].apply(&block);
  EXPECT_LT(LargestResidual_px(block, block.points), 0.01);
}

TEST(BlocksExchange, ReadsTiePointsOfAnotherFileAndArchives) {
  const ImportedBlock truth = ExchangeTruth();
  const StatusOr<TempFolder> folder = TempFolder::Create("");
  const std::string base = folder->path();
  const ExchangeWriteOptions options{.tie_point_path = "D:\\project\\ties.xml"};
  const std::string text = WriteBlocksExchange(truth, options), ties = WriteExchangeTiePoints(truth, options);
  const auto read = [](const std::string& path) {
    EXPECT_TRUE(IsBlocksExchange(path)) << path;
    ExchangeResult result;
    result.block = ReadBlocksExchange(path, {}, &result.faults, &result.warnings);
    EXPECT_EQ(result.Message(), "");
    return result;
  };
  ASSERT_TRUE(WriteFileAtomic(base + "/block.any", text).ok());
  ExchangeResult result = read(base + "/block.any");
  EXPECT_THAT(result.warnings, ElementsAre(HasSubstr("ties.xml' does not exist")));
  EXPECT_THAT(result.block.points, IsEmpty());
  ASSERT_TRUE(
      WriteFileAtomic(base + "/b.xmz", MakeZip({{"readme", "x"}, {"a/b.xml", text}, {"a/ties.xml", ties}})).ok());
  ExpectBlockNear(read(base + "/b.xmz").block, truth);
  ASSERT_TRUE(WriteFileAtomic(base + "/ties.xml", MakeZip({{"t", ties}})).ok());
  ExpectBlockNear(read(base + "/block.any").block, truth);
  ASSERT_TRUE(WriteFileAtomic(base + "/ties.xml", "<?xml version=\"1.0\"?>\n" + ties).ok());
  result = read(base + "/block.any");
  ExpectBlockNear(result.block, truth);
  EXPECT_EQ(result.block.points.size(), truth.points.size());
  EXPECT_THAT(result.block.files, ElementsAre(base + "/block.any", base + "/ties.xml"));
  ASSERT_TRUE(WriteFileAtomic(base + "/other", "<Block/>").ok());
  EXPECT_FALSE(IsBlocksExchange(base + "/other"));
  EXPECT_FALSE(IsBlocksExchange(base));
  ASSERT_TRUE(WriteFileAtomic(base + "/gzip", std::string("\x1f\x8b\x08\0", 4)).ok());
  Faults faults;
  ReadBlocksExchange(base + "/gzip", {}, &faults, &result.warnings);
  EXPECT_THAT(faults.messages(), ElementsAre(HasSubstr("gunzip")));
}

TEST(BlocksExchange, PositionsKeepTheirReferenceSystem) {
  const ImportedBlock truth = ExchangeTruth();
  ImportedBlock block =
      ExpectExchange(WriteBlocksExchange(truth, {.block_srs = "ENU:48.8,2.3", .photogroup_srs = "EPSG: 2154"}));
  EXPECT_EQ(block.crs, "EPSG:2154");
  EXPECT_THAT(block.points, IsEmpty());
  EXPECT_THAT(block.left_out, Contains("60 tie points in another system than the poses"));
  block = ExpectExchange(
      WriteBlocksExchange(truth, {.block_srs = "ENU:1,2", .photogroup_srs = "WGS84", .tie_point_srs = "EPSG:4326"}));
  EXPECT_EQ(block.crs, "EPSG:4326");
  ExpectBlockNear(block, truth);
  EXPECT_EQ(ExpectExchange(WriteBlocksExchange(truth, {.block_srs = ""})).crs, "");
  const std::string text = WriteBlocksExchange(truth, {.photogroup_srs = "EPSG:32631"});
  const std::string first_only =
      absl::StrReplaceAll(text, {{"<Name>camera 1</Name><SRSId>1</SRSId>", "<Name>camera 1</Name>"}});
  EXPECT_THAT(ParseExchange(first_only).Message(), HasSubstr("poses in 2 systems: 'EPSG:2154', 'EPSG:32631'"));
  EXPECT_THAT(ParseExchange(absl::StrReplaceAll(text, {{"<Id>1</Id>", "<Id>5</Id>"}})).Message(),
              HasSubstr("found SRS 1"));
}

TEST(BlocksExchange, APositionAloneIsNoPose) {
  ImportedBlock truth = ExchangeTruth();
  truth.images[2].oriented = false;
  const std::string text = WriteBlocksExchange(truth, {});
  for (BlockTiePoint& point : truth.points) {
    std::erase_if(point.observations, [](const BlockObservation& seen) { return seen.image == 2; });
  }
  std::erase_if(truth.points, [](const BlockTiePoint& point) { return point.observations.empty(); });
  const ImportedBlock block = ExpectExchange(text);
  ExpectBlockNear(block, truth);
  EXPECT_THAT(block.left_out, Contains(HasSubstr("measurements in photographs without a pose")));
}

TEST(BlocksExchange, ChoosesTheLargestComponentOrTheWantedOne) {
  ImportedBlock truth = ExchangeTruth();
  for (size_t i = 0; i < truth.images.size(); ++i) truth.images[i].component = i < 4 ? 0 : i < 7 ? 1 : 2;
  const std::string text = WriteBlocksExchange(truth, {});
  const auto oriented = [](const ImportedBlock& block) {
    std::vector<size_t> images;
    for (size_t i = 0; i < block.images.size(); ++i) {
      if (block.images[i].oriented) images.push_back(i);
    }
    return images;
  };
  const ImportedBlock block = ExpectExchange(text);
  EXPECT_THAT(oriented(block), ElementsAre(4, 5, 6));
  EXPECT_THAT(block.left_out, Contains(HasSubstr("the poses of 6 images of other components than 1 (3 images)")));
  EXPECT_THAT(oriented(ParseExchange(text, 2).block), ElementsAre(7, 8));
  EXPECT_THAT(ParseExchange(text, 3).Message(), HasSubstr("1 (3 images), 2 (2 images)"));
}

TEST(BlocksExchange, KeepsTiePointsWithoutPosition) {
  const ImportedBlock truth = ExchangeTruth();
  std::string text = WriteBlocksExchange(truth, {});
  const size_t begin = text.find("<TiePoint><Position>") + 10, end = text.find("</Position>", begin) + 11;
  text.erase(begin, end - begin);
  const ImportedBlock block = ExpectExchange(text);
  ASSERT_EQ(block.points.size(), truth.points.size());
  EXPECT_EQ(block.points[0].position, Eigen::Vector3d::Zero());
  EXPECT_EQ(block.points[0].observations.size(), truth.points[0].observations.size());
  EXPECT_LT((block.points[1].position - truth.points[1].position).norm(), 1e-4);
}

TEST(BlocksExchange, ReadsControlPoints) {
  const ImportedBlock truth = ExchangeTruth();
  const std::string points = absl::StrReplaceAll(WriteExchangeTiePoints(truth, {}), {{"TiePoint", "ControlPoint"}});
  const std::string extra = "<ControlPoint><Category>Vertical</Category><Position><z>1</z></Position></ControlPoint>";
  const ImportedBlock block = ExpectExchange(absl::StrReplaceAll(
      WriteBlocksExchange(truth, {}),
      {{"</Photogroups>", absl::StrCat("</Photogroups><ControlPoints>", points, extra, "</ControlPoints>")}}));
  EXPECT_EQ(block.control_points.size(), truth.points.size());
  EXPECT_LT(LargestResidual_px(block, block.control_points), 0.01);
  EXPECT_THAT(block.left_out, Contains(HasSubstr("1 control points without position")));
}

TEST(BlocksExchange, ReportsAllFaultsWithTheirPlaces) {
  const std::string text = WriteBlocksExchange(ExchangeTruth(), {});
  const auto with = [&](const std::string& old_text, const std::string& new_text) {
    std::string changed = text;
    const size_t at = changed.find(old_text);
    EXPECT_NE(at, std::string::npos) << old_text;
    return changed.replace(at, old_text.size(), new_text);
  };
  EXPECT_THAT(ParseExchange(with("Perspective", "Fisheye")).Message(),
              AllOf(HasSubstr("b.xml: /BlocksExchange/Block/Photogroups/Photogroup/CameraModelType (line "),
                    HasSubstr("found 'Fisheye'"), HasSubstr("undistorted")));
  EXPECT_THAT(ParseExchange(with("<M_00>-0", "<M_00>-9")).Message(), HasSubstr("a matrix that is no rotation"));
  EXPECT_THAT(ParseExchange(with("<M_00>", "<M_00>nan")).Message(), HasSubstr("Rotation/M_00 (line "));
  EXPECT_THAT(ParseExchange(with("<Id>101</Id>", "<Id>100</Id>")).Message(), HasSubstr("a second photograph 100"));
  EXPECT_THAT(ParseExchange(with("XRightYDown", "XRightYLeft")).Message(), HasSubstr("'XRightYLeft'"));
  EXPECT_THAT(ParseExchange(with("<Width>4000", "<Width>0")).Message(), HasSubstr("0 x 3000"));
  EXPECT_THAT(ParseExchange(with("<FocalLengthPixels>", "<X>")).Message(), HasSubstr("not well-formed"));
  EXPECT_THAT(ParseExchange(with("FocalLengthPixels>3400</FocalLengthPixels", "X>1</X")).Message(),
              HasSubstr("FocalLength 0, SensorSize 0"));
  EXPECT_THAT(ParseExchange(with("<Block>", "<Block/><Block>")).Message(), HasSubstr("several blocks"));
  EXPECT_THAT(ParseExchange(text.substr(0, text.size() / 2)).Message(), HasSubstr("cut off"));
  EXPECT_THAT(ParseExchange("<BlocksExchange version=\"3.2\"><Block/></BlocksExchange>").Message(),
              HasSubstr("no Photogroup"));
  const std::string twice = absl::StrReplaceAll(text, {{"<M_11>", "<M_11>x"}, {"XRightYDown", "?"}});
  const std::string message = ParseExchange(twice).Message();
  EXPECT_THAT(message, AllOf(HasSubstr("M_11"), HasSubstr("CameraOrientation"), HasSubstr("\n")));
}

TEST(BlocksExchange, CountsMeasurementsOfUnknownPhotographsAndRefusesDoubleOnes) {
  const ImportedBlock truth = ExchangeTruth();
  std::string text = WriteBlocksExchange(truth, {});
  const std::string id = absl::StrCat("<PhotoId>", 100 + truth.points[0].observations[0].image);
  std::string unknown = text;
  unknown.replace(unknown.find(id), id.size(), "<PhotoId>999");
  EXPECT_THAT(ExpectExchange(unknown).left_out, Contains("1 measurements in photographs that the file does not list"));
  const size_t begin = text.find("<Measurement>"), end = text.find("</Measurement>") + 14;
  text.insert(end, text.substr(begin, end - begin));
  EXPECT_THAT(ParseExchange(text).Message(), HasSubstr("a second measurement in photograph"));
}

}  // namespace
}  // namespace tessera
