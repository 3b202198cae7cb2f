// NVM is read with the poses, lenses and positions of the program that wrote it.
#include "common/blocks/nvm.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "common/imaging/image_io.h"
#include "common/storage/files.h"
#include "tests/support/blocks/compare_blocks.h"
#include "tests/support/blocks/truth_block.h"
#include "tests/support/blocks/write_nvm.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

ImportedBlock NvmTruth(LensModel::Kind lens) {
  TruthOptions options;
  options.lens = lens;
  return WithCentredCameras(MakeTruthBlock(options));
}

// The sizes of truth's photographs, by path.
PhotographSize NvmSizesOf(const ImportedBlock& truth) {
  return [truth](const std::string& path) -> StatusOr<ImageSize> {
    for (const BlockImage& image : truth.images) {
      const PinholeCamera& p = truth.cameras[image.camera].lens.pinhole;
      if (image.path == path) return ImageSize{p.width, p.height};
    }
    return absl::NotFoundError(absl::StrCat("no file ", path));
  };
}

ImportedBlock ParseGoodNvm(const std::string& text, const ImportedBlock& truth, int component = -1) {
  Faults faults;
  BlockReadOptions options;
  options.component = component;
  ImportedBlock block = ParseNvm(text, "a.nvm", NvmSizesOf(truth), options, &faults);
  EXPECT_THAT(faults.messages(), IsEmpty());
  return block;
}

std::vector<std::string> NvmFaults(const std::string& text, const ImportedBlock& truth, int component = -1) {
  Faults faults;
  BlockReadOptions options;
  options.component = component;
  ParseNvm(text, "a.nvm", NvmSizesOf(truth), options, &faults);
  return faults.messages();
}

const BlockReading& NvmReading(const ImportedBlock& block, const std::string& program) {
  for (const BlockReading& reading : block.readings) {
    if (reading.name.starts_with(program)) return reading;
  }
  ADD_FAILURE() << "no reading of " << program;
  static const BlockReading none{"", [](ImportedBlock*) {}};
  return none;
}

void ExpectNvmMatches(const ImportedBlock& block, const ImportedBlock& truth) {
  const BlockErrors errors = CompareBlocks(block, truth);
  EXPECT_LT(errors.centre, 1e-4);
  EXPECT_LT(errors.rotation, 1e-7);
  EXPECT_LT(errors.reprojection_px, 0.01);
  EXPECT_LT(errors.observation_px, 0.01);
}

TEST(NvmTest, ReadsColmapsFileAsItIs) {
  for (const LensModel::Kind lens : {LensModel::Kind::kPinhole, LensModel::Kind::kSimpleRadial}) {
    ImportedBlock truth = NvmTruth(lens);
    for (BlockCamera& camera : truth.cameras) camera.lens.coefficients[0] = truth.cameras[0].lens.coefficients[0];
    for (BlockTiePoint& point : truth.points) {
      for (BlockObservation& o : point.observations)
        o.position_px = ProjectInBlock(truth, truth.images[o.image], point.position);
    }
    const double k = truth.cameras[0].lens.coefficients[0];
    for (const bool has_matrices : {false, true}) {
      const std::string header = has_matrices ? "NVM_V3_R9T" : "NVM_V3";
      const ImportedBlock block = ParseGoodNvm(NvmText(truth, NvmDialect::kColmap, -k, header, has_matrices), truth);
      EXPECT_EQ(block.version, header);
      EXPECT_THAT(block.cameras, SizeIs(2));  // shared by images with equal lenses
      EXPECT_THAT(block.points, SizeIs(truth.points.size()));
      EXPECT_EQ(block.cameras[0].lens.kind, lens);
      ExpectNvmMatches(block, truth);
    }
  }
}

TEST(NvmTest, ReadsVisualSfmsFileByItsReading) {
  for (const double k : {0.0, 0.17, -0.1, 0.4}) {
    ImportedBlock truth = WithInverseRadial(NvmTruth(LensModel::Kind::kPinhole), k);
    ImportedBlock block = ParseGoodNvm(NvmText(truth, NvmDialect::kVisualSfm, k), truth);
    EXPECT_GT(CompareBlocks(block, truth).observation_px, 1000) << "the positions are those of COLMAP";
    NvmReading(block, "VisualSFM").apply(&block);
    ExpectNvmMatches(block, truth);
  }
}

TEST(NvmTest, ReadsOpenSfmsFileByItsReading) {
  const ImportedBlock truth = NvmTruth(LensModel::Kind::kPinhole);
  ImportedBlock block = ParseGoodNvm(NvmText(truth, NvmDialect::kOpenSfm, 0), truth);
  EXPECT_GT(CompareBlocks(block, truth).observation_px, 100) << "the positions are those of COLMAP";
  NvmReading(block, "OpenSfM").apply(&block);
  ExpectNvmMatches(block, truth);
}

TEST(NvmTest, ReadsFixedLens) {
  TruthOptions options;
  options.square_pixels = false;
  ImportedBlock truth = MakeTruthBlock(options);
  truth.cameras[1].lens = truth.cameras[0].lens;
  for (BlockTiePoint& point : truth.points) {
    for (BlockObservation& o : point.observations)
      o.position_px = ProjectInBlock(truth, truth.images[o.image], point.position);
  }
  const PinholeCamera& p = truth.cameras[0].lens.pinhole;
  const std::string header = absl::StrFormat("NVM_V3 FixedK %.17g %.17g %.17g %.17g", p.fx, p.cx, p.fy, p.cy);
  for (const char* radial : {"", " 0"}) {
    ExpectNvmMatches(ParseGoodNvm(NvmText(truth, NvmDialect::kColmap, 0, header + radial), truth), truth);
    ImportedBlock block = ParseGoodNvm(NvmText(truth, NvmDialect::kVisualSfm, 0, header + radial), truth);
    NvmReading(block, "VisualSFM").apply(&block);
    ExpectNvmMatches(block, truth);
  }
  EXPECT_THAT(NvmFaults(NvmText(truth, NvmDialect::kColmap, 0.1, header + " 0.2"), truth),
              testing::Contains(HasSubstr("found radial distortion 0.1, expected 0.2 of FixedK, or 0")));
  EXPECT_THAT(NvmFaults(NvmText(truth, NvmDialect::kColmap, 0, "NVM_V3 FixedK 1 2 3"), truth),
              ElementsAre(HasSubstr("a.nvm: line 1: found another header, expected NVM_V3 alone or with FixedK")));
}

TEST(NvmTest, ReadsNamesWithBlanks) {
  ImportedBlock truth = NvmTruth(LensModel::Kind::kPinhole);
  truth.images[0].path = "my images/IMG 1.jpg";
  truth.images[1].path = "my images/IMG 2.jpg";
  truth.images[2].path = "my images/IMG 3.jpg";
  std::string text = NvmText(truth, NvmDialect::kColmap, 0);
  text = absl::StrReplaceAll(
      text, {{"my images/IMG 2.jpg", "\"my images/IMG 2.jpg\""}, {"my images/IMG 3.jpg ", "my\"images/IMG\"3.jpg\t"}});
  const ImportedBlock block = ParseGoodNvm(text, truth);
  ASSERT_THAT(block.images, SizeIs(truth.images.size()));
  for (size_t i = 0; i < truth.images.size(); ++i) EXPECT_EQ(block.images[i].path, truth.images[i].path);
}

TEST(NvmTest, ReadsOneModelOfSeveral) {
  const ImportedBlock truth = NvmTruth(LensModel::Kind::kPinhole);
  ImportedBlock small = truth;
  small.images.resize(2);
  for (BlockTiePoint& point : small.points) {
    std::erase_if(point.observations, [](const BlockObservation& o) { return o.image > 1; });
  }
  const auto body = [](const ImportedBlock& block) {
    std::string text = NvmText(block, NvmDialect::kColmap, 0);
    text = text.substr(text.find('\n') + 1);
    return text.substr(0, text.find("\n0\n") + 1);
  };
  ImportedBlock loose = truth;
  loose.points.clear();
  const std::string text = absl::StrCat("NVM_V3\n", body(small), body(truth), body(loose), "\n0\n0\n");
  const ImportedBlock largest = ParseGoodNvm(text, truth);
  ExpectNvmMatches(largest, truth);
  EXPECT_THAT(largest.left_out,
              ElementsAre(HasSubstr("model 0: 2 images and "), HasSubstr("model 2: 9 images without points")));
  ExpectNvmMatches(ParseGoodNvm(text, truth, 0), small);
  EXPECT_THAT(NvmFaults(text, truth, 3), ElementsAre("a.nvm: found 3 models, expected model 3, counted from 0"));
}

TEST(NvmTest, ReportsEveryFault) {
  const ImportedBlock truth = NvmTruth(LensModel::Kind::kPinhole);
  const std::string text = NvmText(truth, NvmDialect::kColmap, 0);
  const auto lines = [&] {
    std::vector<std::string> all = absl::StrSplit(text, '\n');
    return all;
  }();
  const auto with = [&](size_t number, const std::string& line) {
    std::vector<std::string> all = lines;
    all[number - 1] = line;
    return absl::StrJoin(all, "\n");
  };
  EXPECT_THAT(NvmFaults("", truth), ElementsAre(HasSubstr("found an empty file, expected NVM_V3")));
  EXPECT_THAT(NvmFaults("NVM_V2\n", truth), ElementsAre(HasSubstr("line 1: found 'NVM_V2'")));
  EXPECT_THAT(NvmFaults(with(3, "many"), truth), ElementsAre(HasSubstr("line 3: found 'many', expected the number")));
  EXPECT_THAT(NvmFaults(with(3, "1000000000"), truth), ElementsAre(HasSubstr("no more than a file of ")));
  EXPECT_THAT(NvmFaults(with(4, "a.jpg 3400 1 0 0 0 1 2 nan 0 0"), truth),
              ElementsAre(HasSubstr("line 4: found 'nan'")));
  EXPECT_THAT(NvmFaults(with(4, "3400 1 0 0 0 1 2 3 0 0"), truth), ElementsAre(HasSubstr("found a shorter line")));
  const std::string two =
      absl::StrReplaceAll(with(4, "images/a/IMG_100.jpg 0 1 0.1 0 0 1 2 3 0 0"), {{" 10 20 30 ", " 10 20 30 9"}});
  EXPECT_THAT(NvmFaults(two, truth), testing::Contains(HasSubstr("line 4: found 0, expected a focal length above 0")));
  EXPECT_THAT(NvmFaults(two, truth), testing::Contains(HasSubstr("line 4: found a quaternion of length 1.00499")));
  EXPECT_THAT(NvmFaults(two, truth), SizeIs(2 + truth.points.size()));
  EXPECT_THAT(NvmFaults(with(15, "1 2 3 4 5 6 1 9 0 10 10"), truth),
              ElementsAre("a.nvm: line 15: found image 9, expected an index below 9"));
  EXPECT_THAT(NvmFaults(with(15, "1 2 3 4 5 6 1 0 0 10 10 7"), truth),
              ElementsAre(HasSubstr("found '7', expected the end")));
  EXPECT_THAT(
      NvmFaults(with(5, lines[3]), truth),
      ElementsAre(HasSubstr("line 5: found image images/a/IMG_100.jpg again, expected one line; line 4 has it")));
  const std::string cut = text.substr(0, text.size() / 2);
  EXPECT_THAT(NvmFaults(cut.substr(0, cut.rfind('\n') + 1), truth),
              ElementsAre(testing::ContainsRegex("found the end of the file, expected point [0-9]+ of 60")));
  ImportedBlock other = truth;
  other.images[0].path = "elsewhere.jpg";
  EXPECT_THAT(NvmFaults(text, other), ElementsAre(HasSubstr("line 4: found no file images/a/IMG_100.jpg, expected")));
}

TEST(NvmTest, FitsForwardDistortionWithinItsBound) {
  const PinholeCamera pinhole{4000, 3000, 3400, 3400, 2000, 1500};
  for (const double k : {-0.3, -0.15, -0.01, 0.001, 0.05, 0.3, 1.0}) {
    const std::optional<LensModel> lens = LensOfInverseRadial(pinhole, k);
    ASSERT_TRUE(lens.has_value()) << k;
    for (const double x : {0.0, 700.0, 2000.0, 4000.0}) {
      for (const double y : {0.0, 1000.0, 3000.0}) {
        const Eigen::Vector2d distorted(x - 2000, y - 1500);
        const Eigen::Vector2d undistorted = distorted * (1 + k * distorted.squaredNorm() / 3400 / 3400);
        EXPECT_LT((lens->Distort(undistorted + Eigen::Vector2d(2000, 1500)) - Eigen::Vector2d(x, y)).norm(), 0.0101);
      }
    }
  }
  EXPECT_EQ(LensOfInverseRadial(pinhole, 0)->kind, LensModel::Kind::kPinhole);
  EXPECT_FALSE(LensOfInverseRadial(pinhole, -0.7).has_value()) << "two undistorted positions for a distorted one";
  EXPECT_FALSE(LensOfInverseRadial(pinhole, 30).has_value()) << "no polynomial is close";
}

TEST(NvmTest, TakesSizesOfTheImageFiles) {
  const std::string folder = FreshTestFolder("nvm");
  ImportedBlock truth = NvmTruth(LensModel::Kind::kPinhole);
  WriteText(folder + "/block.nvm", NvmText(truth, NvmDialect::kColmap, 0));
  EXPECT_TRUE(IsNvm(folder + "/block.nvm"));
  EXPECT_FALSE(IsNvm(folder));
  EXPECT_FALSE(IsNvm(folder + "/missing.nvm"));
  for (const BlockImage& image : truth.images) {
    const PinholeCamera& p = truth.cameras[image.camera].lens.pinhole;
    const std::string path = absl::StrCat(folder, "/photos/", image.path);
    ASSERT_TRUE(EnsureFolder(path.substr(0, path.rfind('/'))).ok());
    ASSERT_TRUE(WritePng(path, ByteImage(p.width, p.height, 1)).ok());
  }
  Faults faults;
  Warnings warnings;
  BlockReadOptions elsewhere;
  elsewhere.photographs.folders = {folder + "/elsewhere"};
  EXPECT_THAT(ReadNvm(folder + "/block.nvm", elsewhere, &faults, &warnings).missing_images,
              SizeIs(truth.images.size()));
  EXPECT_THAT(faults.messages(), SizeIs(truth.images.size()));
  BlockReadOptions options;
  options.photographs.folders = {folder + "/photos"};
  Faults none;
  const ImportedBlock block = ReadNvm(folder + "/block.nvm", options, &none, &warnings);
  EXPECT_THAT(none.messages(), IsEmpty());
  EXPECT_THAT(block.files, ElementsAre(AbsolutePath(folder + "/block.nvm")));
  ExpectNvmMatches(block, truth);
}

}  // namespace
}  // namespace tessera
