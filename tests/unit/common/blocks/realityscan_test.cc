// RealityScan's sidecars and tables are read with poses and lenses.
#include "common/blocks/realityscan/realityscan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_replace.h"
#include "common/storage/files.h"
#include "tests/support/blocks/compare_blocks.h"
#include "tests/support/blocks/truth_block.h"
#include "tests/support/blocks/write_image_header.h"
#include "tests/support/blocks/write_realityscan.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

ImportedBlock RealityScanTruth(LensModel::Kind lens, bool square_pixels = true) {
  TruthOptions options;
  options.lens = lens;
  options.square_pixels = square_pixels;
  options.centre = {1000, -2000, 40};
  return MakeTruthBlock(options);
}

PhotographSize RealityScanSizesOf(const ImportedBlock& truth) {
  return [truth](const std::string& path) -> StatusOr<ImageSize> {
    for (const BlockImage& image : truth.images) {
      const PinholeCamera& p = truth.cameras[image.camera].lens.pinhole;
      if (image.path == path) return ImageSize{p.width, p.height};
    }
    return absl::NotFoundError(absl::StrCat("no file ", path));
  };
}

std::vector<std::string> RealityScanTableFaults(const std::string& text, const ImportedBlock& truth) {
  ImportedBlock block;
  Faults faults;
  ParseRealityScanCsv(text, "a.csv", RealityScanSizesOf(truth), &block, &faults);
  return faults.messages();
}

std::vector<std::string> RealityScanSidecarFaults(const std::string& text) {
  RealityScanCamera camera;
  Faults faults;
  EXPECT_FALSE(ParseRealityScanXmp(text, "a.xmp", &camera, &faults));
  return faults.messages();
}

// Writes the photographs below `photographs` and the sidecars below `folder`.
void WriteRealityScanFolder(const ImportedBlock& truth, const std::string& folder, const std::string& photographs,
                            const std::string& model) {
  for (int i = 0; i < static_cast<int>(truth.images.size()); ++i) {
    const BlockImage& image = truth.images[i];
    const PinholeCamera& p = truth.cameras[image.camera].lens.pinhole;
    WriteImageHeader(absl::StrCat(photographs, "/", image.path), p.width, p.height);
    const std::string sidecar = absl::StrReplaceAll(absl::StrCat(folder, "/", image.path), {{".jpg", ".xmp"}});
    std::filesystem::create_directories(std::filesystem::path(sidecar).parent_path());
    WriteText(sidecar, RealityScanSidecar(truth, i, model));
  }
}

struct RealityScanResult {
  ImportedBlock block;
  std::vector<std::string> faults;
};
RealityScanResult ReadRealityScanAt(const std::string& path, const BlockReadOptions& options = {}) {
  RealityScanResult result;
  Faults faults;
  Warnings warnings;
  result.block = ReadRealityScan(path, options, &faults, &warnings);
  result.faults = faults.messages();
  return result;
}

void ExpectRealityScanMatches(const ImportedBlock& block, const ImportedBlock& truth) {
  const BlockErrors errors = CompareBlocks(block, truth);
  EXPECT_LT(errors.centre, 1e-4);
  EXPECT_LT(errors.rotation, 1e-7);
  EXPECT_LT(errors.reprojection_px, 0.01);
}

TEST(RealityScanTest, ReadsSidecars) {
  struct Case {
    LensModel::Kind lens;
    const char* model;
    bool square_pixels;
  };
  for (const Case& c :
       {Case{LensModel::Kind::kPinhole, "perspective", true}, Case{LensModel::Kind::kRadial, "brown3", true},
        Case{LensModel::Kind::kOpenCv, "brown3t2", true}, Case{LensModel::Kind::kBrown, "brown4t2", false}}) {
    const std::string folder = FreshTestFolder("realityscan");
    const ImportedBlock truth = RealityScanTruth(c.lens, c.square_pixels);
    WriteRealityScanFolder(truth, folder, folder, c.model);
    WriteText(folder + "/other.xmp", "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"/>");
    ASSERT_TRUE(IsRealityScan(folder));
    const RealityScanResult result = ReadRealityScanAt(folder);
    EXPECT_THAT(result.faults, IsEmpty());
    EXPECT_EQ(result.block.version, "3");
    EXPECT_THAT(result.block.cameras, SizeIs(2));
    EXPECT_THAT(result.block.left_out, Contains("1 files .xmp without properties of RealityScan"));
    ASSERT_THAT(result.block.images, SizeIs(truth.images.size()));
    // Truth's images in the order of the folder.
    ImportedBlock sorted = truth;
    std::vector<int> order(truth.images.size());
    for (size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
    std::sort(order.begin(), order.end(), [&](int a, int b) { return truth.images[a].path < truth.images[b].path; });
    std::vector<int> place(order.size());
    for (size_t i = 0; i < order.size(); ++i) {
      sorted.images[i] = truth.images[order[i]];
      place[order[i]] = static_cast<int>(i);
      EXPECT_EQ(result.block.images[i].path, sorted.images[i].path);
      EXPECT_TRUE(result.block.images[i].oriented);
    }
    for (BlockTiePoint& point : sorted.points) {
      for (BlockObservation& o : point.observations) o.image = place[o.image];
    }
    ExpectRealityScanMatches(result.block, sorted);
  }
}

TEST(RealityScanTest, ReadsTables) {
  for (const LensModel::Kind lens : {LensModel::Kind::kPinhole, LensModel::Kind::kOpenCv, LensModel::Kind::kBrown}) {
    ImportedBlock truth = RealityScanTruth(lens);
    for (BlockCamera& camera : truth.cameras) camera.lens.coefficients[6] = 0;  // tables have no skew
    for (BlockTiePoint& point : truth.points) {
      for (BlockObservation& o : point.observations)
        o.position_px = ProjectInBlock(truth, truth.images[o.image], point.position);
    }
    for (const bool is_new : {true, false}) {
      ImportedBlock block;
      Faults faults;
      ParseRealityScanCsv(RealityScanTable(truth, is_new), "a.csv", RealityScanSizesOf(truth), &block, &faults);
      EXPECT_THAT(faults.messages(), IsEmpty());
      EXPECT_THAT(block.left_out, IsEmpty());
      ExpectRealityScanMatches(block, truth);
    }
  }
}

TEST(RealityScanTest, AnglesAreThoseOfItsHelp) {
  const ImportedBlock truth = RealityScanTruth(LensModel::Kind::kPinhole);
  const std::string header = "#name,x,y,alt,heading,pitch,roll,f,extra\n";
  const std::string name = truth.images[0].path;
  const auto rotation = [&](const std::string& angles) {
    ImportedBlock block;
    Faults faults;
    ParseRealityScanCsv(absl::StrCat(header, name, ",1,2,3,", angles, ",30,7\n"), "a.csv", RealityScanSizesOf(truth),
                        &block, &faults);
    EXPECT_THAT(faults.messages(), IsEmpty());
    EXPECT_THAT(block.left_out, ElementsAre("columns extra"));
    return block.images.at(0).rotation_cam_from_block;
  };
  const auto rows = [](const Eigen::Vector3d& x, const Eigen::Vector3d& y, const Eigen::Vector3d& z) {
    return (Eigen::Matrix3d() << x.transpose(), y.transpose(), z.transpose()).finished();
  };
  const Eigen::Vector3d east(1, 0, 0), north(0, 1, 0), up(0, 0, 1);
  // Looks down, the upper side of the image to the north.
  EXPECT_TRUE(rotation("0,0,0").isApprox(rows(east, -north, -up), 1e-12));
  // Looks down, the upper side to the east.
  EXPECT_TRUE(rotation("90,0,0").isApprox(rows(-north, -east, -up), 1e-12));
  // Looks to the east and the horizon.
  EXPECT_TRUE(rotation("90,90,0").isApprox(rows(-north, -up, east), 1e-12));
  // Looks to the west and the horizon, the upper side of the image to the north.
  EXPECT_TRUE(rotation("0,0,90").isApprox(rows(-up, -north, -east), 1e-12));
}

TEST(RealityScanTest, TangentialTermsAreThoseOfItsHelp) {
  RealityScanCamera camera;
  camera.focal_35mm = 36;
  camera.distortion = {0, 0, 0, 0, 0.001, 0.002};  // t1 on x: r^2 + 2 x^2
  const LensModel lens = RealityScanLens(camera, {1000, 500});
  const Eigen::Vector2d p = lens.Distort({500 + 1000 * 0.3, 250 + 1000 * 0.2});
  const double x = 0.3, y = 0.2, r2 = x * x + y * y, t1 = 0.001, t2 = 0.002;
  EXPECT_NEAR(p.x(), 500 + 1000 * (x + t1 * (r2 + 2 * x * x) + 2 * t2 * x * y), 1e-9);
  EXPECT_NEAR(p.y(), 250 + 1000 * (y + t2 * (r2 + 2 * y * y) + 2 * t1 * x * y), 1e-9);
}

TEST(RealityScanTest, FindsPhotographsInAnotherFolder) {
  const std::string folder = AbsolutePath(FreshTestFolder("realityscan"));
  ImportedBlock truth = RealityScanTruth(LensModel::Kind::kPinhole);
  truth.images.resize(2);
  truth.points.clear();
  WriteRealityScanFolder(truth, folder + "/sidecars", folder + "/photographs", "brown3");
  EXPECT_THAT(ReadRealityScanAt(folder + "/sidecars").faults,
              ElementsAre(HasSubstr("images/a/IMG_100', expected one image file"), HasSubstr("IMG_101.xmp")));
  BlockReadOptions options;
  options.photographs.folders = {folder + "/photographs"};
  const RealityScanResult result = ReadRealityScanAt(folder + "/sidecars", options);
  EXPECT_THAT(result.faults, IsEmpty());
  ASSERT_THAT(result.block.images, SizeIs(2));
  EXPECT_EQ(result.block.images[0].path, folder + "/photographs/images/a/IMG_100.jpg");
  WriteImageHeader(folder + "/photographs/images/a/IMG_100.png", 10, 10);
  EXPECT_THAT(ReadRealityScanAt(folder + "/sidecars", options).faults,
              ElementsAre(HasSubstr("photographs/images/a/IMG_100.jpg or " + folder)));
}

TEST(RealityScanTest, ReadsOneComponent) {
  const std::string folder = FreshTestFolder("realityscan");
  const ImportedBlock truth = RealityScanTruth(LensModel::Kind::kPinhole);
  for (int i = 0; i < 5; ++i) {
    WriteImageHeader(absl::StrCat(folder, "/", i, ".jpg"), 4000, 3000);
    WriteText(absl::StrCat(folder, "/", i, ".xmp"), RealityScanSidecar(truth, i, "brown3", i < 2 ? "{A}" : "{B}"));
  }
  const RealityScanResult largest = ReadRealityScanAt(folder + "/3.xmp");
  EXPECT_THAT(largest.block.images, SizeIs(3));
  EXPECT_THAT(largest.block.left_out, Contains(HasSubstr("component 0 ({A}): 2 images")));
  BlockReadOptions options;
  options.component = 0;
  EXPECT_THAT(ReadRealityScanAt(folder, options).block.images, SizeIs(2));
  options.component = 2;
  EXPECT_THAT(ReadRealityScanAt(folder, options).faults,
              ElementsAre(HasSubstr("found 2 components, expected component 2")));
}

TEST(RealityScanTest, ReadsPropertiesInEitherForm) {
  const ImportedBlock truth = RealityScanTruth(LensModel::Kind::kPinhole);
  const std::string text = RealityScanSidecar(truth, 0, "brown3");
  RealityScanCamera camera;
  Faults faults;
  // Another prefix; the position as an attribute; no rotation.
  std::string other = absl::StrReplaceAll(text, {{"xcr", "rc"},
                                                 {"<xcr:Rotation>", "<rc:Unknown>"},
                                                 {"</xcr:Rotation>", "</rc:Unknown>"},
                                                 {"xcr:PosePrior", "rc:Position=\"1 2 3\" rc:PosePrior"}});
  other = absl::StrReplaceAll(other, {{"/ns/rc/1.1#", "/ns/xcr/1.1#"}});
  EXPECT_TRUE(ParseRealityScanXmp(other, "a.xmp", &camera, &faults));
  EXPECT_EQ(camera.position, Eigen::Vector3d(1, 2, 3));
  EXPECT_FALSE(camera.has_rotation);
  // Other namespaces are ignored.
  EXPECT_FALSE(
      ParseRealityScanXmp(absl::StrReplaceAll(text, {{"/ns/xcr/1.1#", "/ns/camera/1.0/"}}), "a.xmp", &camera, &faults));
  EXPECT_THAT(faults.messages(), IsEmpty());
}

TEST(RealityScanTest, ReportsEveryFaultOfSidecars) {
  const ImportedBlock truth = RealityScanTruth(LensModel::Kind::kBrown);
  const std::string text = RealityScanSidecar(truth, 0, "brown4t2");
  const auto with = [&](const std::string& from, const std::string& to) {
    EXPECT_THAT(text, HasSubstr(from));
    return absl::StrReplaceAll(text, {{from, to}});
  };
  EXPECT_THAT(RealityScanSidecarFaults(text.substr(0, 300)), ElementsAre(HasSubstr("a.xmp: byte ")));
  EXPECT_THAT(RealityScanSidecarFaults(with("brown4t2", "division")),
              ElementsAre(HasSubstr("xcr:DistortionModel: found 'division', expected brown3, brown4, ")));
  EXPECT_THAT(RealityScanSidecarFaults(with("brown4t2", "brown3t2")),
              ElementsAre(HasSubstr("only those of brown3t2 in k1 k2")));
  EXPECT_THAT(RealityScanSidecarFaults(with("brown4t2", "brown4")),
              ElementsAre(HasSubstr("that the lens model does not have")));
  EXPECT_THAT(RealityScanSidecarFaults(with("Version=\"3\"", "Version=\"9\"")),
              ElementsAre(HasSubstr("found '9', expected 2, 3")));
  EXPECT_THAT(RealityScanSidecarFaults(with("FocalLength35mm=\"", "FocalLength35mm=\"-")),
              ElementsAre(HasSubstr("above 0")));
  EXPECT_THAT(RealityScanSidecarFaults(with("<xcr:Position>", "<xcr:Position>nan 7 ")),
              ElementsAre(HasSubstr("xcr:Position: found 5 words, expected 3 finite numbers")));
  EXPECT_THAT(
      RealityScanSidecarFaults(
          absl::StrReplaceAll(text, {{"<xcr:Rotation>", "<xcr:Rotation>1 0 0 0 1 0 1 0 0</xcr:Rotation><xcr:Old>"},
                                     {"</xcr:Rotation>", "</xcr:Old>"},
                                     {"PrincipalPointU=\"", "PrincipalPointU=\"x"}})),
      ElementsAre(HasSubstr("xcr:PrincipalPointU: found 'x"), HasSubstr("xcr:Rotation: found a matrix that is no")));
}

TEST(RealityScanTest, ReportsEveryFaultOfTables) {
  const ImportedBlock truth = RealityScanTruth(LensModel::Kind::kPinhole);
  const std::string text = RealityScanTable(truth, true), old = RealityScanTable(truth, false);
  const std::string name = truth.images[0].path, second = truth.images[1].path;
  const auto with = [&](const std::string& from, const std::string& to) {
    return absl::StrReplaceAll(text, {{from, to}});
  };
  EXPECT_THAT(RealityScanTableFaults("", truth),
              ElementsAre(HasSubstr("found the end of the file, expected a header")));
  EXPECT_THAT(RealityScanTableFaults(with("yaw", "azimuth"), truth),
              ElementsAre(HasSubstr("a.csv: line 1: found '#name,x,y,alt,azimuth")));
  EXPECT_THAT(RealityScanTableFaults(with("k4", "yaw"), truth), ElementsAre(HasSubstr("found column yaw again")));
  EXPECT_THAT(RealityScanTableFaults(with(name + ",", name + ",nan,"), truth),
              ElementsAre(HasSubstr("line 2: found 17 columns, expected 16 columns")));
  EXPECT_THAT(RealityScanTableFaults(text.substr(0, text.size() - 30), truth), SizeIs(1));
  EXPECT_THAT(
      RealityScanTableFaults(with(second + ",", name + ","), truth),
      ElementsAre(HasSubstr("line 3: found image images/a/IMG_100.jpg again, expected one line; line 2 has it")));
  EXPECT_THAT(RealityScanTableFaults(with(name, "elsewhere.jpg"), truth),
              ElementsAre(HasSubstr("line 2: found no file elsewhere.jpg, expected one image file")));
  EXPECT_THAT(RealityScanTableFaults(absl::StrReplaceAll(old, {{"#cameras 9", "#cameras 10"}}), truth),
              ElementsAre("a.csv: found 9 images, expected 10, as #cameras says"));
  EXPECT_THAT(RealityScanTableFaults(text.substr(0, text.find('\n') + 1), truth), ElementsAre(HasSubstr("no images")));
  const std::string one = absl::StrCat("#name,x,y,alt,yaw,pitch,roll,f\n", name, ",1,2,inf,0,z,0,0\n");
  EXPECT_THAT(RealityScanTableFaults(one, truth),
              ElementsAre(HasSubstr("found 'inf', expected a number in column alt"),
                          HasSubstr("found 'z', expected a number in column pitch")));
}

TEST(RealityScanTest, ChoosesAmongFiles) {
  const std::string folder = FreshTestFolder("realityscan");
  EXPECT_FALSE(IsRealityScan(folder));
  const ImportedBlock truth = RealityScanTruth(LensModel::Kind::kPinhole);
  WriteText(folder + "/notes.csv", "a,b,c\n");
  EXPECT_FALSE(IsRealityScan(folder));
  WriteText(folder + "/a.csv", RealityScanTable(truth, true));
  WriteText(folder + "/b.csv", RealityScanTable(truth, false));
  EXPECT_TRUE(IsRealityScan(folder));
  EXPECT_TRUE(IsRealityScan(folder + "/b.csv"));
  EXPECT_THAT(ReadRealityScanAt(folder).faults, ElementsAre(HasSubstr("found 2 tables of camera parameters")));
  EXPECT_THAT(ReadRealityScanAt(folder + "/b.csv").faults, SizeIs(truth.images.size()));  // no photographs
  for (const BlockImage& image : truth.images) {
    const PinholeCamera& p = truth.cameras[image.camera].lens.pinhole;
    WriteImageHeader(absl::StrCat(folder, "/", image.path), p.width, p.height);
  }
  const RealityScanResult table = ReadRealityScanAt(folder + "/b.csv");
  EXPECT_THAT(table.faults, IsEmpty());
  ExpectRealityScanMatches(table.block, truth);
  WriteText(folder + "/images/a/IMG_100.xmp", RealityScanSidecar(truth, 0, "brown3"));
  const RealityScanResult sidecar = ReadRealityScanAt(folder);
  EXPECT_THAT(sidecar.faults, IsEmpty());
  EXPECT_THAT(sidecar.block.images, SizeIs(1));
  EXPECT_THAT(sidecar.block.left_out, Contains(HasSubstr("b.csv: the sidecars are read instead")));
}

}  // namespace
}  // namespace tessera
