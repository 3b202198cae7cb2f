#include "common/blocks/openmvs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "common/storage/files.h"
#include "tests/support/blocks/named_block_errors.h"
#include "tests/support/blocks/truth_block.h"
#include "tests/support/blocks/write_openmvs.h"

namespace tessera {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

ImportedBlock MvsTruth(double skew = 0) {
  TruthOptions options;
  options.square_pixels = false;
  options.centre = {12, -30, 4};
  ImportedBlock truth = MakeTruthBlock(options);
  if (skew != 0) {
    for (BlockCamera& camera : truth.cameras) {
      camera.lens.kind = LensModel::Kind::kBrown;
      camera.lens.coefficients[6] = skew;
    }
    ObserveAgain(&truth);
  }
  return truth;
}

struct MvsResult {
  ImportedBlock block;
  std::string faults;
};

MvsResult ParseMvs(const std::string& bytes) {
  MvsResult result;
  Faults faults;
  const auto image_size = [](const std::string& name) -> StatusOr<ImageSize> {
    if (name.find("/a/") != std::string::npos) return ImageSize{4000, 3000};  // as MakeTruthBlock names them
    if (name.find("/b/") != std::string::npos) return ImageSize{2800, 3600};
    return absl::NotFoundError("no file of this name");
  };
  result.block = ParseOpenMvs(bytes, "scene.mvs", image_size, &faults);
  result.faults = absl::StrJoin(faults.messages(), "\n");
  return result;
}

void ExpectMvsTruth(const MvsResult& read, const ImportedBlock& truth, const std::string& what) {
  EXPECT_EQ(read.faults, "") << what;
  const NamedBlockErrors errors = CompareByName(read.block, truth);
  EXPECT_EQ(errors.images, truth.images.size()) << what;
  EXPECT_LT(errors.centre, 1e-9) << what;
  EXPECT_LT(errors.rotation, 1e-9) << what;
  EXPECT_LT(errors.reprojection_px, 1e-6) << what;
}

TEST(OpenMvs, ReadsAllVersionsOfTheInterface) {
  const ImportedBlock truth = MvsTruth();
  for (uint32_t version = 1; version <= 7; ++version) {
    OpenMvsWriting how;
    how.version = version;
    const MvsResult read = ParseMvs(WriteOpenMvs(truth, how));
    ExpectMvsTruth(read, truth, absl::StrCat("version ", version));
    EXPECT_EQ(read.block.version, absl::StrCat(version));
    EXPECT_THAT(read.block.left_out, ElementsAre(HasSubstr("60 points")));
    EXPECT_TRUE(read.block.points.empty());
    EXPECT_THAT(read.block.conventions, Not(testing::Contains(HasSubstr("shares of the longer side"))));
  }
}

TEST(OpenMvs, ReadsSharesOfTheLongerSideWithTheSizesOfImages) {
  const ImportedBlock truth = MvsTruth();
  OpenMvsWriting how;
  how.normalised = true;
  const MvsResult read = ParseMvs(WriteOpenMvs(truth, how));
  // The half pixel is added to pixels, not to shares.
  ExpectMvsTruth(read, truth, "shares");
  EXPECT_THAT(read.block.conventions, testing::Contains(HasSubstr("shares of the longer side")));
  ImportedBlock other = truth;
  other.images[2].path = "images/c.jpg";
  EXPECT_THAT(ParseMvs(WriteOpenMvs(other, how)).faults,
              AllOf(HasSubstr("image 2 (images/c.jpg): found "), HasSubstr("the format states no image size")));
}

TEST(OpenMvs, ReadsSkew) {
  const ImportedBlock truth = MvsTruth(2.5);
  const MvsResult read = ParseMvs(WriteOpenMvs(truth));
  ExpectMvsTruth(read, truth, "skew");
  EXPECT_EQ(read.block.cameras[0].lens.kind, LensModel::Kind::kBrown);
}

TEST(OpenMvs, KeepsImagesWithoutAPoseAsNotOriented) {
  ImportedBlock truth = MvsTruth();
  OpenMvsWriting how;
  how.unposed_last = true;
  const MvsResult read = ParseMvs(WriteOpenMvs(truth, how));
  EXPECT_EQ(read.faults, "");
  ASSERT_EQ(read.block.images.size(), truth.images.size());
  EXPECT_TRUE(read.block.images.front().oriented);
  EXPECT_FALSE(read.block.images.back().oriented);
  EXPECT_THAT(read.block.left_out, testing::Contains(HasSubstr("poses of 1 images")));
}

TEST(OpenMvs, TellsOfATransform) {
  OpenMvsWriting how;
  how.transform(0, 3) = -5;
  EXPECT_THAT(ParseMvs(WriteOpenMvs(MvsTruth(), how)).block.left_out, testing::Contains(HasSubstr("transform")));
}

TEST(OpenMvs, RefusesEveryCut) {
  const std::string bytes = WriteOpenMvs(MvsTruth());
  for (size_t size = 4; size < bytes.size(); size += size < 600 ? 1 : 97)
    EXPECT_THAT(ParseMvs(bytes.substr(0, size)).faults, HasSubstr("scene.mvs: byte ")) << size;
  EXPECT_THAT(ParseMvs(bytes + "x").faults, HasSubstr("found 1 more bytes"));
}

TEST(OpenMvs, RefusesCountsThatDoNotFit) {
  std::string bytes = WriteOpenMvs(MvsTruth());
  const uint64_t count = uint64_t{1} << 60;
  std::memcpy(bytes.data() + 12, &count, sizeof(count));  // of platforms
  EXPECT_THAT(ParseMvs(bytes).faults, HasSubstr("scene.mvs: byte 12: found a size of 1152921504606846976"));
  OpenMvsWriting how;
  how.normals = 7;
  EXPECT_THAT(ParseMvs(WriteOpenMvs(MvsTruth(), how)).faults, HasSubstr("7 of the points' normals, expected 60"));
}

TEST(OpenMvs, RefusesOtherVersionsAndProjects) {
  OpenMvsWriting how;
  how.version = 8;
  EXPECT_THAT(ParseMvs(WriteOpenMvs(MvsTruth(), how)).faults, HasSubstr("byte 4: found version 8"));
  EXPECT_THAT(ParseMvs(std::string("MVS\0\1\0\0\0", 8)).faults,
              testing::AllOf(HasSubstr("an OpenMVS project"), HasSubstr("InterfaceCOLMAP")));
  EXPECT_THAT(ParseMvs("MVSX").faults, HasSubstr("expected MVSI"));
}

TEST(OpenMvs, NamesWhatIsWrong) {
  ImportedBlock truth = MvsTruth();
  truth.images[3].rotation_cam_from_block(1, 1) += 0.01;
  truth.images[4].centre.x() = NAN;
  truth.images[6].path = truth.images[5].path;
  const std::string faults = ParseMvs(WriteOpenMvs(truth)).faults;
  EXPECT_THAT(faults, HasSubstr("image 3 (images/b/IMG_103.jpg): found a pose 3 that is no rotation"));
  EXPECT_THAT(faults, HasSubstr("image 4 (images/a/IMG_104.jpg): found a pose 4 that is no rotation"));
  EXPECT_THAT(faults, HasSubstr("image 6 (images/b/IMG_105.jpg): found the name of another image"));
  truth = MvsTruth();
  truth.images[1].rotation_cam_from_block = -truth.images[1].rotation_cam_from_block;  // a mirror
  EXPECT_THAT(ParseMvs(WriteOpenMvs(truth)).faults, HasSubstr("image 1"));
  truth = MvsTruth();
  truth.cameras[1].lens.pinhole.fx = -3000;
  EXPECT_THAT(ParseMvs(WriteOpenMvs(truth)).faults, HasSubstr("camera 1 of platform 0: found a matrix K"));
  truth = MvsTruth();
  truth.points[0].observations[0].image = 99;
  EXPECT_THAT(ParseMvs(WriteOpenMvs(truth)).faults, HasSubstr("found image 99, expected one of 9 images"));
  truth = MvsTruth();
  truth.images.resize(1);
  truth.images[0].camera = 0;
  for (BlockTiePoint& point : truth.points) point.observations.clear();
  std::string bytes = WriteOpenMvs(truth);
  EXPECT_EQ(ParseMvs(bytes).faults, "");
}

TEST(OpenMvs, TakesSizesOfImagesBesideTheFileOrInTheFolderOfTheOption) {
  StatusOr<TempFolder> folder = TempFolder::Create("");
  ASSERT_TRUE(folder.ok());
  ImportedBlock truth = MvsTruth();
  truth.images.resize(2);
  truth.points.clear();
  OpenMvsWriting how;
  how.normalised = true;
  const std::string scene = folder->path() + "/scene.mvs";
  ASSERT_TRUE(WriteFileAtomic(scene, WriteOpenMvs(truth, how)).ok());
  Warnings warnings;
  EXPECT_THAT(ReadBlock(scene, std::nullopt, {}, &warnings).status().message(),
              HasSubstr("no file of image 'images/a/IMG_100.jpg', expected one image file"));
  std::filesystem::create_directories(folder->path() + "/images/a");
  std::filesystem::create_directories(folder->path() + "/other");
  ASSERT_TRUE(WritePng(folder->path() + "/images/a/IMG_100.jpg", ByteImage(40, 30, 1)).ok());
  ASSERT_TRUE(WritePng(folder->path() + "/other/IMG_101.jpg", ByteImage(28, 36, 1)).ok());
  BlockReadOptions options;
  options.photographs.folders = {folder->path() + "/other"};
  const StatusOr<ImportedBlock> block = ReadBlock(scene, std::nullopt, options, &warnings);
  ASSERT_TRUE(block.ok()) << block.status();
  EXPECT_EQ(block->format, "openmvs");
  const PinholeCamera& camera = block->cameras[block->images[1].camera].lens.pinhole;
  EXPECT_EQ(camera.width, 28);
  EXPECT_EQ(camera.height, 36);
  EXPECT_NEAR(camera.fx, truth.cameras[1].lens.pinhole.fx / 100, 1e-9);
}

}  // namespace
}  // namespace tessera
