// Pix4D's camera parameters are read with poses, lenses, offset and tie points.
#include "common/blocks/pix4d/pix4d.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "common/blocks/pix4d/pix4d_tie_points.h"
#include "tests/support/blocks/compare_blocks.h"
#include "tests/support/blocks/truth_block.h"
#include "tests/support/blocks/write_pix4d.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

const Eigen::Vector3d kPix4dOffset(500100, 5400200, 300);

ImportedBlock Pix4dTruth(LensModel::Kind lens, double k3 = 0) {
  TruthOptions options;
  options.lens = lens;
  options.square_pixels = lens == LensModel::Kind::kPinhole;
  options.centre = kPix4dOffset + Eigen::Vector3d(20, -30, 5);
  ImportedBlock block = MakeTruthBlock(options);
  for (BlockImage& image : block.images) image.path = image.path.substr(image.path.rfind('/') + 1);
  for (BlockCamera& camera : block.cameras) {
    double* c = camera.lens.coefficients;
    if (k3 != 0) {
      c[4] = k3;
      camera.lens.kind = LensModel::Kind::kFullOpenCv;
    }
    c[5] = 0;  // Pix4D has no term of r^8
  }
  for (BlockTiePoint& point : block.points) {
    for (BlockObservation& o : point.observations)
      o.position_px = ProjectInBlock(block, block.images[o.image], point.position);
  }
  return block;
}

struct Pix4dResult {
  ImportedBlock block;
  std::vector<std::string> faults;
  Warnings warnings;
};
Pix4dResult ReadPix4dAt(const std::string& path) {
  Pix4dResult result;
  Faults faults;
  result.block = ReadPix4d(path, {}, &faults, &result.warnings);
  result.faults = faults.messages();
  return result;
}

std::vector<std::string> Pix4dFaults(const std::string& cameras) {
  ImportedBlock block;
  Faults faults;
  ParsePix4dCameras(cameras, "c.txt", &block, &faults);
  return faults.messages();
}

void ExpectPix4dMatches(const ImportedBlock& block, const ImportedBlock& truth) {
  const BlockErrors errors = CompareBlocks(block, truth);
  EXPECT_LT(errors.centre, 1e-4);
  EXPECT_LT(errors.rotation, 1e-7);
  EXPECT_LT(errors.reprojection_px, 0.01);
  EXPECT_LT(errors.observation_px, 0.01);
}

TEST(Pix4dTest, ReadsAProject) {
  using Kind = LensModel::Kind;
  for (const auto& [lens, k3] :
       {std::pair(Kind::kPinhole, 0.0), {Kind::kOpenCv, 0.0}, {Kind::kOpenCv, -0.02}, {Kind::kBrown, 0.0}}) {
    const std::string folder = FreshTestFolder("pix4d");
    const ImportedBlock truth = Pix4dTruth(lens, k3);
    WriteText(folder + "/a_calibrated_camera_parameters.txt", Pix4dCameraText(truth, kPix4dOffset));
    WriteText(folder + "/a_offset.xyz", "500100.000 5400200.000 300.000\n");
    WriteText(folder + "/a_wkt.prj", "PROJCS[\"WGS 84 / UTM zone 32N\"]\n");
    WriteText(folder + "/a_pmatrix.txt", Pix4dMatrixText(truth, kPix4dOffset));
    WriteText(folder + "/a_tp_pix4d.txt", Pix4dTiePointText(truth));
    ASSERT_TRUE(IsPix4d(folder));
    const Pix4dResult result = ReadPix4dAt(folder);
    EXPECT_THAT(result.faults, IsEmpty());
    EXPECT_THAT(result.warnings, IsEmpty());
    EXPECT_EQ(result.block.offset, kPix4dOffset);
    EXPECT_EQ(result.block.crs, "PROJCS[\"WGS 84 / UTM zone 32N\"]");
    EXPECT_TRUE(result.block.adjusted_in_grid);
    EXPECT_THAT(result.block.cameras, SizeIs(2));  // shared by images with equal lenses
    EXPECT_THAT(result.block.files, SizeIs(5));
    EXPECT_THAT(result.block.left_out, IsEmpty());
    EXPECT_THAT(result.block.conventions, Contains(HasSubstr("agrees with the matrices of a_pmatrix.txt within 0.0")));
    ASSERT_THAT(result.block.points, SizeIs(truth.points.size()));
    ExpectPix4dMatches(result.block, truth);
    for (const BlockTiePoint& point : result.block.points) {
      double nearest = HUGE_VAL;
      for (const BlockTiePoint& of : truth.points) {
        nearest = std::min(nearest, (of.position - kPix4dOffset - point.position).norm());
      }
      EXPECT_LT(nearest, 1e-3);
    }
  }
}

TEST(Pix4dTest, TakesTheOffsetFromExternalPositions) {
  const std::string folder = FreshTestFolder("pix4d"), params = folder + "/1_initial/params";
  const ImportedBlock truth = Pix4dTruth(LensModel::Kind::kPinhole);
  std::filesystem::create_directories(params);
  WriteText(params + "/calibrated_camera_parameters.txt", Pix4dCameraText(truth, kPix4dOffset));
  WriteText(params + "/b_wkt.prj", "LOCAL_CS[\"Arbitrary\"]");
  Pix4dResult result = ReadPix4dAt(folder);
  EXPECT_EQ(result.block.offset, Eigen::Vector3d::Zero());
  EXPECT_EQ(result.block.crs, "");
  EXPECT_THAT(result.warnings, ElementsAre(HasSubstr("neither offset.xyz nor calibrated_external_camera_parameters")));
  EXPECT_THAT(result.block.left_out, ElementsAre(HasSubstr("tie points: ")));

  const std::string external = params + "/b_calibrated_external_camera_parameters.txt";
  WriteText(external, Pix4dExternalText(truth));
  result = ReadPix4dAt(params + "/calibrated_camera_parameters.txt");
  EXPECT_THAT(result.faults, IsEmpty());
  EXPECT_THAT(result.warnings, IsEmpty());
  EXPECT_EQ(result.block.offset, kPix4dOffset);
  EXPECT_THAT(result.block.left_out, Contains(HasSubstr("b_wkt.prj: a local coordinate system")));
  ExpectPix4dMatches(result.block, truth);

  ImportedBlock moved = truth;
  moved.images[3].centre.x() += 0.02;
  WriteText(external, Pix4dExternalText(moved));
  EXPECT_THAT(ReadPix4dAt(folder).faults, ElementsAre(HasSubstr("differ by 0.02")));
  WriteText(external, "imageName X Y Z Omega Phi Kappa\nother.jpg 1 2 3 4 5 6\n");
  EXPECT_THAT(ReadPix4dAt(folder).faults, ElementsAre(HasSubstr("found no image of the camera parameters")));
}

TEST(Pix4dTest, RefusesMatricesOfAnotherAdjustment) {
  const std::string folder = FreshTestFolder("pix4d");
  const ImportedBlock truth = Pix4dTruth(LensModel::Kind::kPinhole);
  ImportedBlock other = truth;
  other.images[2].centre.x() += 0.05;  // 1.6 pixels at 100 metres
  WriteText(folder + "/calibrated_camera_parameters.txt", Pix4dCameraText(truth, kPix4dOffset));
  WriteText(folder + "/pmatrix.txt", Pix4dMatrixText(other, kPix4dOffset));
  EXPECT_THAT(ReadPix4dAt(folder).faults,
              ElementsAre(HasSubstr("line 3: found a matrix of IMG_102.jpg that is off by ")));
}

TEST(Pix4dTest, ReadsNamesWithBlanks) {
  ImportedBlock truth = Pix4dTruth(LensModel::Kind::kPinhole);
  truth.images[0].path = "IMG 100 a.jpg";
  const std::string folder = FreshTestFolder("pix4d");
  WriteText(folder + "/calibrated_camera_parameters.txt", Pix4dCameraText(truth, kPix4dOffset));
  WriteText(folder + "/calibrated_external_camera_parameters.txt", Pix4dExternalText(truth));
  WriteText(folder + "/pmatrix.txt", Pix4dMatrixText(truth, kPix4dOffset));
  WriteText(folder + "/tp_pix4d.txt", Pix4dTiePointText(truth));
  const Pix4dResult result = ReadPix4dAt(folder);
  EXPECT_THAT(result.faults, IsEmpty());
  EXPECT_THAT(result.block.left_out, IsEmpty());
  ASSERT_THAT(result.block.points, SizeIs(truth.points.size()));
  EXPECT_THAT(result.block.conventions, Contains(HasSubstr("median of 9 images")));
  ExpectPix4dMatches(result.block, truth);
}

TEST(Pix4dTest, LeavesOutTiePointsThatGiveNoPosition) {
  ImportedBlock block;
  Faults faults;
  const ImportedBlock truth = Pix4dTruth(LensModel::Kind::kPinhole);
  ParsePix4dCameras(Pix4dCameraText(truth, kPix4dOffset), "c.txt", &block, &faults);
  ParsePix4dTiePoints("IMG_100\n5 10 10 1\n5 10.5 10 1\n6 20 20 1\n-99\nIMG_999\n5 1 1 1\n-99\n", "t.txt", &block,
                      &faults);
  EXPECT_THAT(faults.messages(), IsEmpty());
  EXPECT_THAT(block.points, IsEmpty());
  EXPECT_THAT(block.left_out, ElementsAre(HasSubstr("2 of 2 tie points"), HasSubstr("tie points of 1 images without")));
  ParsePix4dTiePoints("IMG_100\n5 10 10\n6 x 1 1\n7 1 1 1\n", "t.txt", &block, &faults);
  EXPECT_THAT(faults.messages(),
              ElementsAre(HasSubstr("t.txt: line 2: found '5'"), HasSubstr("t.txt: line 3: found '6'")));
  Faults cut;
  ParsePix4dTiePoints("IMG_100\n5 10 10 1\n", "t.txt", &block, &cut);
  EXPECT_THAT(cut.messages(), ElementsAre(HasSubstr("found the end of the file, expected -99")));
}

TEST(Pix4dTest, ReportsEveryFault) {
  const ImportedBlock truth = Pix4dTruth(LensModel::Kind::kOpenCv);
  const std::string text = Pix4dCameraText(truth, kPix4dOffset);
  std::vector<std::string> lines = absl::StrSplit(text, '\n');
  const auto with = [&](const std::vector<std::pair<int, std::string>>& changes) {
    std::vector<std::string> all = lines;
    for (const auto& [number, line] : changes) all[number - 1] = line;
    return absl::StrJoin(all, "\n");
  };
  EXPECT_THAT(Pix4dFaults(""), ElementsAre(HasSubstr("found no header")));
  EXPECT_THAT(Pix4dFaults(with({{3, "fisheye distortion [C D E F]"}})),
              ElementsAre(HasSubstr("c.txt: line 3: found 'fisheye distortion [C D E F]'")));
  EXPECT_THAT(Pix4dFaults(text.substr(0, text.size() - 40)),
              ElementsAre(HasSubstr("3 numbers: a row of the rotation")));
  EXPECT_THAT(Pix4dFaults(with({{15, "1 2 nan"}})),
              ElementsAre(HasSubstr("line 15: found more words or a number that")));
  EXPECT_THAT(Pix4dFaults(with({{9, "IMG_100.jpg 4000"}})), ElementsAre(HasSubstr("expected an image: name, width")));
  // Images are on lines 9, 19, 29, ...
  EXPECT_THAT(
      Pix4dFaults(with({{10, "-3400 0 2000"}, {26, "1 0 0"}, {39, lines[8]}})),
      ElementsAre(HasSubstr("c.txt: line 9: found a camera matrix of another form"),
                  HasSubstr("c.txt: line 19: found a matrix that is no rotation"),
                  HasSubstr("c.txt: line 39: found image IMG_100.jpg again, expected one entry; line 9 has it")));
  EXPECT_THAT(Pix4dFaults(text.substr(0, text.find("IMG_100"))), ElementsAre(HasSubstr("found no images")));
}

TEST(Pix4dTest, ReadsOneProjectOnly) {
  const std::string folder = FreshTestFolder("pix4d");
  EXPECT_FALSE(IsPix4d(folder));
  const std::string text = Pix4dCameraText(Pix4dTruth(LensModel::Kind::kPinhole), kPix4dOffset);
  WriteText(folder + "/a_calibrated_camera_parameters.txt", text);
  WriteText(folder + "/b.txt", text);  // detected by content
  EXPECT_TRUE(IsPix4d(folder + "/b.txt"));
  EXPECT_THAT(ReadPix4dAt(folder).faults, ElementsAre(HasSubstr("found 2 projects: ")));
  WriteText(folder + "/x_offset.xyz", "1 2 3\n");
  WriteText(folder + "/y_offset.xyz", "4 5 6\n");
  const Pix4dResult result = ReadPix4dAt(folder + "/b.txt");
  EXPECT_THAT(result.warnings, ElementsAre(HasSubstr("2 files *offset.xyz, none of them offset.xyz; none is read")));
  EXPECT_EQ(result.block.offset, Eigen::Vector3d::Zero());
}

}  // namespace
}  // namespace tessera
