#include "common/blocks/metashape/metashape.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <filesystem>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "common/blocks/metashape/metashape_crs.h"
#include "common/storage/files.h"
#include "tests/support/blocks/expect_block_near.h"
#include "tests/support/blocks/make_zip.h"
#include "tests/support/blocks/truth_block.h"
#include "tests/support/blocks/write_metashape.h"

namespace tessera {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr char kWgs84[] =
    "GEOGCS[\"WGS 84\",DATUM[\"World Geodetic System 1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],"
    "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433],AUTHORITY[\"EPSG\",\"4326\"]]";
constexpr char kLocal[] = "LOCAL_CS[\"Local Coordinates (m)\",LOCAL_DATUM[\"Local Datum\",0],UNIT[\"metre\",1]]";
const Eigen::Vector3d kEarthPoint(4201000, 172000, 4780000);

MetashapeWorld SomeWorld(const Eigen::Vector3d& translation, double scale) {
  return {Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, -3).normalized()).toRotationMatrix(), translation, scale};
}

struct MetashapeResult {
  ImportedBlock block;
  Faults faults;
  Warnings warnings;
  std::string Message() const { return std::string(faults.ToStatus().message()); }
};

MetashapeResult ParseMeta(const std::string& bytes, int component = -1) {
  MetashapeResult result;
  result.block = ParseMetashape(bytes, "m.xml", {component}, &result.faults, &result.warnings);
  return result;
}

MetashapeResult ReadMeta(const std::string& path) {
  EXPECT_TRUE(IsMetashape(path)) << path;
  MetashapeResult result;
  result.block = ReadMetashape(path, {}, &result.faults, &result.warnings);
  EXPECT_EQ(result.Message(), "");
  return result;
}

TEST(Metashape, ReadsCamerasOfBothFormsWithTheirTransforms) {
  using Kind = LensModel::Kind;
  for (const Kind lens : {Kind::kPinhole, Kind::kSimpleRadial, Kind::kOpenCv, Kind::kBrown}) {
    for (const bool old_form : {false, true}) {
      for (const bool has_component : {false, true}) {
        SCOPED_TRACE(absl::StrCat("lens ", static_cast<int>(lens), " old ", old_form, " component ", has_component));
        const ImportedBlock truth =
            MakeTruthBlock({.lens = lens, .square_pixels = false, .centre = {999000, 112000, 50}});
        MetashapeWriteOptions options{.old_form = old_form, .has_component = has_component, .reference = kLocal};
        options.chunk = SomeWorld({999100, 112100, 60}, 3.5);
        if (has_component) options.component = SomeWorld({5, -6, 7}, 0.25);
        MetashapeResult result = ParseMeta(WriteMetashapeXml(truth, options));
        EXPECT_EQ(result.Message(), "");
        EXPECT_THAT(result.warnings, IsEmpty());
        ExpectBlockNear(result.block, truth);
        EXPECT_EQ(result.block.crs, "");
        EXPECT_EQ(result.block.version, "2.0.0");
        EXPECT_EQ(result.block.images[3].path, truth.images[3].path);
        EXPECT_THAT(result.block.readings, SizeIs(lens >= Kind::kOpenCv));
      }
    }
  }
}

TEST(Metashape, OffersTheOtherOrderOfP1AndP2) {
  const ImportedBlock truth = MakeTruthBlock({.lens = LensModel::Kind::kBrown});
  ImportedBlock block = ParseMeta(WriteMetashapeXml(truth, {.exchanged_p = true})).block;
  EXPECT_GT(LargestResidual_px(block, truth.points), 0.5);
  ASSERT_THAT(block.readings, SizeIs(1));
  block.readings[0].apply(&block);
  EXPECT_LT(LargestResidual_px(block, truth.points), 0.01);
}

TEST(Metashape, GeoreferencedChunksAreEarthCentred) {
  const ImportedBlock truth = MakeTruthBlock({.lens = LensModel::Kind::kOpenCv, .centre = kEarthPoint});
  MetashapeWriteOptions options{.has_component = true, .has_chunk = false};
  options.component = SomeWorld(kEarthPoint, 12.3);
  for (const std::string& reference :
       {std::string(kWgs84), absl::StrCat("PROJCS[\"UTM 31N\",", kWgs84, ",UNIT[\"metre\",1]]")}) {
    options.reference = reference;
    const MetashapeResult result = ParseMeta(WriteMetashapeXml(truth, options));
    EXPECT_EQ(result.Message(), "");
    EXPECT_THAT(result.warnings, IsEmpty());
    ExpectBlockNear(result.block, truth);
    EXPECT_EQ(result.block.crs, "EPSG:4978");
    EXPECT_EQ(result.block.mesh_crs, reference);
  }
  options.reference = "";
  const MetashapeResult result = ParseMeta(WriteMetashapeXml(truth, options));
  EXPECT_EQ(result.block.crs, "EPSG:4978");
  EXPECT_THAT(result.warnings, ElementsAre(HasSubstr("taken as WGS 84")));
}

// Their coordinates are in the reference, the poses are earth-centred.
TEST(Metashape, MarkersOfGeoreferencedChunksAreLeftOut) {
  const ImportedBlock truth = MakeTruthBlock({.centre = kEarthPoint});
  MetashapeWriteOptions options{.has_component = true, .has_chunk = false, .reference = kWgs84};
  options.component = SomeWorld(kEarthPoint, 12.3);
  const std::string text = absl::StrReplaceAll(
      WriteMetashapeXml(truth, options),
      {{"</cameras>\n",
        "</cameras>\n<markers><marker id=\"2\" label=\"m\"><reference x=\"2.3\" y=\"48.8\" "
        "z=\"30\"/></marker></markers>"
        "<frames><frame id=\"0\"><markers><marker marker_id=\"2\"><location camera_id=\"10\" x=\"5\" y=\"6\"/>"
        "</marker></markers></frame></frames>\n"}});
  const MetashapeResult result = ParseMeta(text);
  EXPECT_EQ(result.Message(), "");
  EXPECT_THAT(result.block.left_out, ElementsAre("1 markers with coordinates in another system than the poses"));
  EXPECT_THAT(result.block.control_points, IsEmpty());
  ExpectBlockNear(result.block, truth);
}

TEST(Metashape, ARepeatedTransformAppliesOnce) {
  const ImportedBlock truth = MakeTruthBlock({.centre = kEarthPoint});
  MetashapeWriteOptions options{.has_component = true, .has_chunk = false, .reference = kWgs84};
  options.component = SomeWorld(kEarthPoint, 12.3);
  const std::string text =
      absl::StrReplaceAll(WriteMetashapeXml(truth, options),
                          {{"</chunk>", absl::StrCat(MetashapeTransformText(options.component), "</chunk>")}});
  ExpectBlockNear(ParseMeta(text).block, truth);
}

TEST(Metashape, WarnsWithoutScaleAndPosition) {
  const MetashapeResult result =
      ParseMeta(WriteMetashapeXml(MakeTruthBlock(), {.has_chunk = false, .reference = kWgs84}));
  EXPECT_EQ(result.Message(), "");
  EXPECT_EQ(result.block.crs, "");
  EXPECT_THAT(result.warnings, ElementsAre(HasSubstr("no scale and no position")));
}

TEST(Metashape, ReadsTiePointsAndMarkersOfAPsz) {
  const ImportedBlock truth = MakeTruthBlock({.lens = LensModel::Kind::kOpenCv, .centre = {999000, 112000, 50}});
  MetashapeWriteOptions options{.reference = kLocal};
  options.chunk = SomeWorld({999100, 112100, 60}, 30);
  auto [cloud, files] = WriteMetashapePoints(truth, options);
  const BlockTiePoint& point = truth.points[4];
  std::string locations;
  for (const BlockObservation& seen : point.observations) {
    absl::StrAppend(&locations, absl::StrFormat("<location camera_id=\"%d\" pinned=\"true\" x=\"%.9g\" y=\"%.9g\"/>",
                                                10 + seen.image, seen.position_px.x(), seen.position_px.y()));
  }
  options.frame = absl::StrCat("<cameras><camera camera_id=\"10\"><photo path=\"../photos/x.jpg\"/></camera></cameras>",
                               "<markers><marker marker_id=\"2\">", locations, "</marker></markers>", cloud);
  const std::string markers = absl::StrFormat(
      "</cameras><markers><marker id=\"2\" label=\"m\"><reference x=\"%.17g\" y=\"%.17g\" "
      "z=\"%.17g\"/></marker></markers>",
      point.position.x(), point.position.y(), point.position.z());
  std::string xml = WriteMetashapeXml(truth, options);
  xml.replace(xml.find("</cameras>\n<reference>"), 10, markers);
  xml = absl::StrReplaceAll(xml, {{"<chunk label", "<chunks><chunk label"}, {"</chunk>", "</chunk></chunks>"}});
  files.push_back({"doc.xml", xml});
  MetashapeResult result = ParseMeta(MakeZip(files));
  EXPECT_EQ(result.Message(), "");
  EXPECT_THAT(result.block.left_out, IsEmpty());
  ExpectBlockNear(result.block, truth, 1e-3);
  EXPECT_EQ(result.block.points.size(), truth.points.size());
  EXPECT_LT(LargestResidual_px(result.block, result.block.points), 0.05);  // positions are floats
  ASSERT_THAT(result.block.control_points, SizeIs(1));
  EXPECT_LT(LargestResidual_px(result.block, result.block.control_points), 0.01);
  EXPECT_EQ(result.block.images[0].path, "../photos/x.jpg");
  EXPECT_EQ(result.block.images[1].path, truth.images[1].path);
  // A damaged list: a row is missing.
  files[1].second.resize(files[1].second.size() - 16);
  EXPECT_THAT(ParseMeta(MakeZip(files)).Message(), HasSubstr("m.xml/p0.ply: found"));
  files.erase(files.begin() + 1);
  EXPECT_THAT(ParseMeta(MakeZip(files)).Message(), HasSubstr("no such member"));
}

TEST(Metashape, ReadsAPsxWithItsFolder) {
  const ImportedBlock truth = MakeTruthBlock({.centre = kEarthPoint});
  MetashapeWriteOptions options{.reference = kWgs84};
  options.chunk = SomeWorld(kEarthPoint, 30);
  const StatusOr<TempFolder> folder = TempFolder::Create("");
  const std::string base = folder->path(), files = base + "/p.files";
  const auto [cloud, points] = WriteMetashapePoints(truth, options);
  auto cloud_files = points;
  cloud_files.push_back({"doc.xml", cloud});
  const std::string chunk =
      absl::StrReplaceAll(MetashapeChunk(truth, options),
                          {{"</chunk>", "<frames><frame id=\"0\" path=\"0/frame.zip\"/></frames></chunk>"}});
  const std::string frame =
      "<frame><cameras><camera camera_id=\"11\"><photo path=\"../../../../photos/y.jpg\"/></camera></cameras>"
      "<point_cloud path=\"point_cloud/point_cloud.zip\"/></frame>";
  const std::string project =
      "<document version=\"1.2.0\"><chunks next_id=\"6\"><chunk id=\"4\" path=\"4/chunk.zip\"/><chunk id=\"5\" "
      "path=\"5/chunk.zip\"/></chunks></document>";
  std::filesystem::create_directories(files + "/5/0/point_cloud");
  std::filesystem::create_directories(files + "/4");
  const auto write = [](const std::string& path, const std::string& bytes) {
    ASSERT_TRUE(WriteFileAtomic(path, bytes).ok()) << path;
  };
  write(base + "/p.psx", "<document version=\"1.2.0\" path=\"{projectname}.files/project.zip\"/>\n");
  write(files + "/project.zip", MakeZip({{"doc.xml", project}}));
  write(files + "/4/chunk.zip", MakeZip({{"doc.xml", "<chunk label=\"empty\"><cameras/></chunk>"}}));
  write(files + "/5/chunk.zip", MakeZip({{"doc.xml", chunk}}));
  write(files + "/5/0/frame.zip", MakeZip({{"doc.xml", frame}}));
  write(files + "/5/0/point_cloud/point_cloud.zip", MakeZip(cloud_files));
  for (const std::string& path : {base + "/p.psx", files}) {
    const MetashapeResult result = ReadMeta(path);
    ExpectBlockNear(result.block, truth, 1e-3);
    EXPECT_EQ(result.block.points.size(), truth.points.size());
    EXPECT_EQ(result.block.images[1].path, base + "/photos/y.jpg");
    EXPECT_THAT(result.warnings, ElementsAre(HasSubstr("of 2 chunks, 'Chunk 1' is read")));
    EXPECT_THAT(result.block.files, Contains(files + "/5/0/frame.zip"));
  }
  write(files + "/project.zip", MakeZip({{"doc.xml", absl::StrReplaceAll(project, {{"5/chunk.zip", "../x.zip"}})}}));
  MetashapeResult result;
  ReadMetashape(base + "/p.psx", {}, &result.faults, &result.warnings);
  EXPECT_THAT(result.Message(), HasSubstr("a path inside the project"));
  write(base + "/other.xml", "<document><body/></document>");
  EXPECT_FALSE(IsMetashape(base + "/other.xml"));
  EXPECT_FALSE(IsMetashape(base));
}

TEST(Metashape, ReportsAllFaultsWithTheirPlaces) {
  const ImportedBlock truth = MakeTruthBlock();
  const std::string text = WriteMetashapeXml(truth, {.has_component = true, .reference = kLocal});
  const auto with = [&](const std::string& old_text, const std::string& new_text) {
    std::string changed = text;
    const size_t at = changed.find(old_text);
    EXPECT_NE(at, std::string::npos) << old_text;
    return ParseMeta(changed.replace(at, old_text.size(), new_text)).Message();
  };
  EXPECT_THAT(with("type=\"frame\">", "type=\"fisheye\">"), HasSubstr("sensor (line 5, byte"));
  EXPECT_THAT(with("type=\"frame\">", "type=\"fisheye\">"), HasSubstr("undistorted"));
  EXPECT_THAT(with("<p1>", "<p3>1</p3><p1>"), HasSubstr("p1 and p2 only"));
  EXPECT_THAT(with("sensor_id=\"3\"", "sensor_id=\"77\""), HasSubstr("found sensor_id 77"));
  EXPECT_THAT(with("id=\"11\"", "id=\"10\""), HasSubstr("a second camera 10"));
  EXPECT_THAT(with("component_id=\"7\"><transform>", "component_id=\"7\"><transform>3"), HasSubstr("'3"));
  EXPECT_THAT(with("component_id=\"7\"><transform>", "component_id=\"7\"><transform>x "), HasSubstr("16 numbers"));
  EXPECT_THAT(with("component_id=\"7\"", "component_id=\"9\""), HasSubstr("the id of a component"));
  EXPECT_THAT(with("<scale>", "<scale>-"), HasSubstr("scale -1"));
  EXPECT_THAT(with("width=\"4000\" height=\"3000\"/>\n", "width=\"3000\" height=\"4000\"/>\n"),
              HasSubstr("as the sensor"));
  EXPECT_THAT(ParseMeta(text, 8).Message(), HasSubstr("7 (9 images)"));
  EXPECT_THAT(ParseMeta(absl::StrReplaceAll(text, {{"<transform>", "<t>"}, {"</transform>", "</t>"}})).Message(),
              HasSubstr("no pose among 9 images"));
  EXPECT_THAT(ParseMeta("<document version=\"1\"><chunks/></document>").Message(), HasSubstr("no chunk"));
  EXPECT_THAT(ParseMeta(text.substr(0, text.size() / 2)).Message(), HasSubstr("cut off"));
  const std::string both = absl::StrReplaceAll(text, {{"<scale>", "<scale>x"}, {"<f>", "<f>-"}});
  EXPECT_THAT(ParseMeta(both).Message(), HasSubstr("\n"));
}

TEST(Metashape, DisabledAndDependentCamerasAreLeftOut) {
  const std::string text = absl::StrReplaceAll(WriteMetashapeXml(MakeTruthBlock(), {.reference = kLocal}),
                                               {{"<camera id=\"10\"", "<camera id=\"10\" enabled=\"false\""},
                                                {"<camera id=\"12\"", "<camera id=\"12\" master_id=\"11\""}});
  const MetashapeResult result = ParseMeta(text);
  EXPECT_EQ(result.Message(), "");
  ASSERT_THAT(result.block.images, SizeIs(8));
  EXPECT_FALSE(result.block.images[0].oriented);
  EXPECT_THAT(result.block.left_out, ElementsAre(HasSubstr("1 cameras of a rig"), "1 disabled cameras"));
}

TEST(GeocentricOf, TakesTheDatum) {
  EXPECT_EQ(GeocentricOf(kWgs84), "EPSG:4978");
  EXPECT_EQ(GeocentricOf(kLocal), "");
  EXPECT_EQ(GeocentricOf(""), "");
  EXPECT_EQ(GeocentricOf("PROJCS[\"a\",GEOGCS[\"b [\",DATUM[\"D\",SPHEROID[\"S\",6377397.155,299.1528128]],"
                         "UNIT[\"degree\",0.0174532925199433]],UNIT[\"metre\",1]]"),
            "GEOCCS[\"earth-centred\",DATUM[\"D\",SPHEROID[\"S\",6377397.155,299.1528128]],PRIMEM[\"Greenwich\",0],"
            "UNIT[\"metre\",1]]");
}

}  // namespace
}  // namespace tessera
