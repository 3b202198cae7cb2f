#include "common/blocks/opensfm/opensfm.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "common/storage/files.h"
#include "tests/support/blocks/named_block_errors.h"
#include "tests/support/blocks/truth_block.h"
#include "tests/support/blocks/write_opensfm.h"

namespace tessera {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Kind = LensModel::Kind;

constexpr char kSfmReference[] =
    R"("reference_lla": {"latitude": 41.304102434528, "longitude": -81.752131255771, "altitude": 3.5}, )";

struct SfmResult {
  ImportedBlock block;
  std::string faults, warnings;
};

SfmResult ParseSfm(const OpenSfmFiles& files, int component = -1) {
  SfmResult result;
  Faults faults;
  Warnings warnings;
  BlockReadOptions options;
  options.component = component;
  result.block = ParseOpenSfm(files, options, &faults, &warnings);
  result.faults = absl::StrJoin(faults.messages(), "\n");
  result.warnings = absl::StrJoin(warnings, "\n");
  return result;
}

SfmResult ParseSfmText(const std::string& reconstructions, const std::string& tracks = "", int component = -1) {
  OpenSfmFiles files;
  files.reconstructions = reconstructions;
  files.tracks = tracks;
  return ParseSfm(files, component);
}

// A block whose lens OpenSfM can hold.
ImportedBlock SfmTruth(Kind kind, const std::string& type, const Eigen::Vector3d& centre = Eigen::Vector3d::Zero()) {
  TruthOptions options;
  options.lens = kind;
  options.square_pixels = false;
  options.centre = centre;
  ImportedBlock truth = MakeTruthBlock(options);
  for (BlockCamera& camera : truth.cameras) {
    PinholeCamera& p = camera.lens.pinhole;
    if (type == "perspective") p.fy = p.fx, p.cx = p.width / 2.0, p.cy = p.height / 2.0;
    for (int k = 5; k < 8; ++k) camera.lens.coefficients[k] = 0;  // brown ends with k3
  }
  ObserveAgain(&truth);
  return truth;
}

TEST(OpenSfm, ReadsWhatWasWrittenForEachLens) {
  const std::pair<Kind, std::string> cases[] = {
      {Kind::kPinhole, "brown"},      {Kind::kPinhole, "perspective"}, {Kind::kSimpleRadial, "simple_radial"},
      {Kind::kRadial, "perspective"}, {Kind::kRadial, "radial"},       {Kind::kOpenCv, "brown"},
      {Kind::kFullOpenCv, "brown"}};
  for (const auto& [kind, type] : cases) {
    const ImportedBlock truth = SfmTruth(kind, type, {120, -340, 55});
    OpenSfmWriting how;
    how.camera_type = type;
    const SfmResult read =
        ParseSfmText(absl::StrCat("[", OpenSfmReconstruction(truth, how), "]"), OpenSfmTracks(truth));
    ASSERT_EQ(read.faults, "") << type;
    const NamedBlockErrors errors = CompareByName(read.block, truth);
    EXPECT_EQ(errors.images, truth.images.size());
    EXPECT_EQ(errors.observations, ObservationsOf(truth));
    EXPECT_EQ(ObservationsOf(read.block), ObservationsOf(truth));
    EXPECT_LT(errors.centre, 1e-6) << type;
    EXPECT_LT(errors.rotation, 1e-9) << type;
    EXPECT_LT(errors.reprojection_px, 1e-4) << type;
    EXPECT_LT(errors.observation_px, 1e-6) << type;
    for (const BlockCamera& camera : read.block.cameras) EXPECT_LE(camera.lens.kind, Kind::kFullOpenCv);
  }
}

TEST(OpenSfm, ReadsAllVersionsOfTracks) {
  const ImportedBlock truth = SfmTruth(Kind::kOpenCv, "brown");
  const std::string text = absl::StrCat("[", OpenSfmReconstruction(truth), "]");
  for (int version = 0; version <= 2; ++version) {
    const SfmResult read = ParseSfmText(text, OpenSfmTracks(truth, version));
    EXPECT_EQ(read.faults, "") << version;
    EXPECT_EQ(CompareByName(read.block, truth).observations, ObservationsOf(truth)) << version;
  }
}

TEST(OpenSfm, ReadsPosesOfRigs) {
  const ImportedBlock truth = SfmTruth(Kind::kOpenCv, "brown");
  OpenSfmWriting how;
  how.rigs = true;
  const SfmResult read = ParseSfmText(absl::StrCat("[", OpenSfmReconstruction(truth, how), "]"), OpenSfmTracks(truth));
  ASSERT_EQ(read.faults, "");
  const NamedBlockErrors errors = CompareByName(read.block, truth);
  EXPECT_LT(errors.centre, 1e-6);
  EXPECT_LT(errors.rotation, 1e-9);
}

TEST(OpenSfm, ReadsTheComponentWithMostImagesOrTheOneOfTheOption) {
  const ImportedBlock truth = SfmTruth(Kind::kOpenCv, "brown");
  ImportedBlock small = truth;
  small.images.resize(3);
  small.points.clear();
  const std::string text = absl::StrCat("[", OpenSfmReconstruction(small), ", ", OpenSfmReconstruction(truth), "]");
  const SfmResult most = ParseSfmText(text, OpenSfmTracks(truth));
  EXPECT_EQ(most.block.images.size(), truth.images.size());
  EXPECT_EQ(most.block.images[0].component, 1);
  EXPECT_THAT(most.block.left_out, ElementsAre("component 0: 3 images"));
  EXPECT_EQ(ParseSfmText(text, "", 0).block.images.size(), 3u);
  EXPECT_THAT(ParseSfmText(text, "", 2).faults, HasSubstr("--component: found 2, expected 0 to 1"));
}

TEST(OpenSfm, PositionsAreAboutTheReference) {
  const ImportedBlock truth = SfmTruth(Kind::kOpenCv, "brown");
  OpenSfmWriting how;
  how.more = kSfmReference;
  const SfmResult own = ParseSfmText(absl::StrCat("[", OpenSfmReconstruction(truth, how), "]"));
  EXPECT_EQ(own.block.crs, "ENU:41.304102434528,-81.752131255771,3.5");
  EXPECT_THAT(own.block.left_out, ElementsAre(HasSubstr("there is no tracks.csv")));
  OpenSfmFiles files;
  const std::string text = absl::StrCat("[", OpenSfmReconstruction(truth), "]");
  files.reconstructions = text;
  files.reference_lla = R"({"latitude": -10.5, "longitude": 20, "altitude": 0})";
  EXPECT_EQ(ParseSfm(files).block.crs, "ENU:-10.500000000000,20.000000000000,0");
  files.reference_lla = R"({"latitude": 0.0, "longitude": 0.0, "altitude": 0})";  // images without GPS
  EXPECT_EQ(ParseSfm(files).block.crs, "");
  files.reference_lla = R"({"latitude": 95, "longitude": 0.0, "altitude": 0})";
  EXPECT_THAT(ParseSfm(files).faults, HasSubstr("reference_lla"));
}

std::string SfmShotsText(const ImportedBlock& block) {
  std::string features;
  for (const BlockImage& image : block.images) {
    features += absl::StrCat(features.empty() ? "" : ", ", "{\"type\": \"Feature\", \"properties\": {\"filename\": \"",
                             image.path, "\", \"translation\": ", SfmNumbers(image.centre), "}}");
  }
  return absl::StrCat("{\"type\": \"FeatureCollection\", \"features\": [", features, "]}");
}

TEST(OpenSfm, ShotsOfTheReportTellProjectedPositions) {
  const Eigen::Vector3d offset(437036, 4572789, 0);
  const ImportedBlock truth = SfmTruth(Kind::kOpenCv, "brown", offset);
  OpenSfmWriting how;
  how.more = kSfmReference;
  how.offset = offset;
  const std::string text = absl::StrCat("[", OpenSfmReconstruction(truth, how), "]"), shots = SfmShotsText(truth);
  OpenSfmFiles files;
  files.reconstructions = text;
  files.shots = shots;
  files.coords = "WGS84 UTM 17N\n437036 4572789\n1 2 3\n";
  const SfmResult projected = ParseSfm(files);
  EXPECT_EQ(projected.faults, "");
  EXPECT_EQ(projected.block.crs, "EPSG:32617");
  EXPECT_EQ(projected.block.offset, offset);
  files.coords = "WGS84 UTM 17S\n437036 4572789\n";
  EXPECT_EQ(ParseSfm(files).block.crs, "EPSG:32717");
  // Another offset: the positions are not those of the report less it, so they are topocentric.
  files.coords = "WGS84 UTM 17N\n437050 4572789\n";
  EXPECT_EQ(ParseSfm(files).block.crs, "ENU:41.304102434528,-81.752131255771,3.5");
  files.coords = {};
  files.proj = "+proj=utm +zone=17 +datum=WGS84 +units=m +no_defs +type=crs";
  EXPECT_EQ(ParseSfm(files).block.crs, "ENU:41.304102434528,-81.752131255771,3.5");
  files.model_geo = "+proj=lcc +lat_0=46.5\n437036 4572789\n";
  EXPECT_EQ(ParseSfm(files).block.crs, "+proj=lcc +lat_0=46.5");
}

TEST(OpenSfm, AReconstructionBesideATopocentricOneIsProjected) {
  const ImportedBlock truth = SfmTruth(Kind::kOpenCv, "brown");
  const std::string text = absl::StrCat("[", OpenSfmReconstruction(truth), "]");
  OpenSfmFiles files;
  files.reconstructions = text;
  files.projected = true;
  EXPECT_THAT(ParseSfm(files).faults, HasSubstr("coords.txt"));
  files.coords = "WGS84 UTM 31N\n500000 4000000\n";
  const SfmResult read = ParseSfm(files);
  EXPECT_EQ(read.faults, "");
  EXPECT_EQ(read.block.crs, "EPSG:32631");
  EXPECT_EQ(read.block.offset, Eigen::Vector3d(500000, 4000000, 0));
  files.coords = "WGS84 UTM 61N\n500000 4000000\n";
  EXPECT_THAT(ParseSfm(files).faults, HasSubstr("coords.txt: line 1: found 'WGS84 UTM 61N'"));
}

TEST(OpenSfm, WarnsIfAllImagesLieBesideTheirGps) {
  ImportedBlock truth = SfmTruth(Kind::kOpenCv, "brown");
  OpenSfmWriting how;
  how.more = kSfmReference;
  const auto with_gps = [&](const Eigen::Vector3d& shift) {
    std::string text = absl::StrCat("[", OpenSfmReconstruction(truth, how), "]");
    for (const BlockImage& image : truth.images) {
      const std::string head = absl::StrCat("\"", image.path, "\": {");
      text = absl::StrReplaceAll(
          text, {{head, absl::StrCat(head, "\"gps_position\": ", SfmNumbers(image.centre - shift), ", ")}});
    }
    return ParseSfmText(text).warnings;
  };
  EXPECT_EQ(with_gps({2, 1, 30}), "");
  EXPECT_THAT(with_gps({40, 30, 0}), HasSubstr("50 m beside their GPS"));
}

TEST(OpenSfm, ReadsAProjectFolder) {
  const ImportedBlock truth = SfmTruth(Kind::kOpenCv, "brown");
  OpenSfmWriting how;
  how.more = kSfmReference;
  StatusOr<TempFolder> folder = TempFolder::Create("");
  ASSERT_TRUE(folder.ok());
  const std::string root = folder->path();
  namespace fs = std::filesystem;
  for (const char* name : {"opensfm/undistorted", "odm_georeferencing", "images/images/a"})
    fs::create_directories(root + "/" + name);
  const std::string text = absl::StrCat("[", OpenSfmReconstruction(truth, how), "]");
  ASSERT_TRUE(WriteFileAtomic(root + "/opensfm/reconstruction.topocentric.json", text).ok());
  ASSERT_TRUE(WriteFileAtomic(root + "/opensfm/reconstruction.json", text).ok());
  ASSERT_TRUE(WriteFileAtomic(root + "/opensfm/undistorted/reconstruction.json", "[]").ok());
  ASSERT_TRUE(WriteFileAtomic(root + "/opensfm/tracks.csv", OpenSfmTracks(truth)).ok());
  ASSERT_TRUE(WriteFileAtomic(root + "/odm_georeferencing/coords.txt", "WGS84 UTM 17N\n437036 4572789\n").ok());
  const std::string image = root + "/images/" + truth.images[0].path;
  ASSERT_TRUE(WriteFileAtomic(image, "x").ok());
  Warnings warnings;
  for (const std::string& path : {root, root + "/opensfm"}) {
    const StatusOr<ImportedBlock> block = ReadBlock(path, std::nullopt, {}, &warnings);
    ASSERT_TRUE(block.ok()) << block.status();
    EXPECT_EQ(block->format, "opendronemap");
    EXPECT_THAT(block->crs, HasSubstr("ENU:41.3"));
    EXPECT_EQ(ObservationsOf(*block), ObservationsOf(truth));
    EXPECT_EQ(block->images[0].path, image) << "the file exists in the folder images";
    EXPECT_EQ(block->images[1].path, truth.images[2].path) << "this one does not";
  }
  const StatusOr<ImportedBlock> projected =
      ReadBlock(root + "/opensfm/reconstruction.json", std::nullopt, {}, &warnings);
  ASSERT_TRUE(projected.ok()) << projected.status();
  EXPECT_EQ(projected->crs, "EPSG:32617");
  EXPECT_THAT(warnings, IsEmpty());
  fs::remove_all(root + "/opensfm");
  EXPECT_THAT(ReadBlock(root, std::nullopt, {}, &warnings).status().message(), HasSubstr("no opensfm/reconstruction"));
}

TEST(OpenSfm, RefusesOtherProjections) {
  const ImportedBlock truth = SfmTruth(Kind::kOpenCv, "brown");
  for (const char* type : {"fisheye", "fisheye_opencv", "spherical", "equirectangular", "dual", "fisheye62"}) {
    OpenSfmWriting how;
    how.camera_type = type;
    const SfmResult read = ParseSfmText(absl::StrCat("[", OpenSfmReconstruction(truth, how), "]"));
    EXPECT_THAT(read.faults, HasSubstr(absl::StrCat("projection_type: found '\"", type, "\"'")));
  }
}

// What is refused if `from` in the reconstruction becomes `to`.
std::string SfmFaultOf(const std::string& from, const std::string& to) {
  ImportedBlock truth = SfmTruth(Kind::kOpenCv, "brown");
  truth.images[0].path = "first.jpg";
  const std::string text = absl::StrCat("[", OpenSfmReconstruction(truth), "]");
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return ParseSfmText(text.substr(0, at) + to + text.substr(at + from.size())).faults;
}

TEST(OpenSfm, NamesWhatIsWrong) {
  EXPECT_THAT(SfmFaultOf("\"camera\": \"camera 0\"", "\"camera\": \"camera 9\""),
              HasSubstr("[0].shots['first.jpg'].camera: found '\"camera 9\"'"));
  EXPECT_THAT(SfmFaultOf("\"rotation\": [", "\"rotation\": [1, "), HasSubstr("[0].shots['first.jpg']: found"));
  EXPECT_THAT(SfmFaultOf("\"translation\": [", "\"translation\": [NaN, "), HasSubstr("reconstruction.json: byte "));
  EXPECT_THAT(SfmFaultOf("\"translation\": [", "\"translation\": [1e999, "), HasSubstr("double's range"));
  EXPECT_THAT(SfmFaultOf("\"width\": 4000", "\"width\": 0"), HasSubstr("[0].cameras['camera 0'].width: found '0'"));
  EXPECT_THAT(SfmFaultOf("\"focal_x\": ", "\"focal_x\": -"), HasSubstr("focal_x"));
  EXPECT_THAT(SfmFaultOf("\"k1\": ", "\"k1\": 1, \"k1\": "), HasSubstr("key 'k1' twice"));
  EXPECT_THAT(SfmFaultOf("\"coordinates\": [", "\"coordinates\": [\"x\", "), HasSubstr("[0].points['0']"));
  EXPECT_THAT(SfmFaultOf("\"shots\": {", "\"other\": {"), HasSubstr("[0].shots: found no images"));
  EXPECT_THAT(ParseSfmText("[{\"cameras\": {").faults, HasSubstr("the file may be cut"));
  EXPECT_THAT(ParseSfmText("{}").faults, HasSubstr("a list of reconstructions"));
  EXPECT_THAT(ParseSfmText("[{\"shots\": [1]}]").faults, HasSubstr("[0].shots: found '[1]', expected an object"));
  EXPECT_THAT(ParseSfmText(std::string(100, '[') + std::string(100, ']')).faults, HasSubstr("levels deep"));
  // The second key of the same name is that of a shot.
  EXPECT_THAT(SfmFaultOf("\"shots\": {", "\"shots\": {\"first.jpg\": {}, "), HasSubstr("key 'first.jpg' twice"));
}

TEST(OpenSfm, NamesWhatIsWrongInTracks) {
  const ImportedBlock truth = SfmTruth(Kind::kOpenCv, "brown");
  const std::string text = absl::StrCat("[", OpenSfmReconstruction(truth), "]");
  const std::string head = "OPENSFM_TRACKS_VERSION_v2\n", shot = truth.images[0].path,
                    line = shot + "\t0\t1\t0.1\t0.1\t1\t1\t1\t1\t-1\t-1\n";
  const auto faults = [&](const std::string& tracks) { return ParseSfmText(text, tracks).faults; };
  EXPECT_EQ(faults(head + line), "");
  EXPECT_EQ(faults(head + line + "\r\n"), "");
  EXPECT_THAT(faults("OPENSFM_TRACKS_VERSION_v3\n"), HasSubstr("tracks.csv: line 1"));
  EXPECT_THAT(faults(head + shot + "\t0\t1\t0.1\n"), HasSubstr("tracks.csv: line 2: found"));
  EXPECT_THAT(faults(head + shot + "\t0\t1\tnan\t0.1\t1\t1\t1\t1\t-1\t-1\n"), HasSubstr("normalised coordinates"));
  EXPECT_THAT(faults(head + shot + "\t0\t1\t812\t300\t1\t1\t1\t1\t-1\t-1\n"), HasSubstr("normalised coordinates"));
  EXPECT_THAT(faults(head + line + line), HasSubstr("one observation of track '0'"));
  std::string many = head;
  for (int i = 0; i < 1000; ++i) many += "x\n";
  EXPECT_LT(faults(many).size(), 4000u);
  const SfmResult other = ParseSfmText(text, head + "z.jpg\t0\t1\t0.1\t0.1\t1\t1\t1\t1\t-1\t-1\n");
  EXPECT_EQ(other.faults, "");
  EXPECT_THAT(other.block.left_out[0], HasSubstr("1 observations of tracks.csv"));
}

}  // namespace
}  // namespace tessera
