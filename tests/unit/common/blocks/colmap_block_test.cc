#include "common/blocks/colmap_block.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "tests/support/blocks/named_block_errors.h"
#include "tests/support/blocks/truth_block.h"
#include "tests/support/blocks/write_colmap_block.h"

namespace tessera {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

ImportedBlock ColmapTruth(int images = 9, LensModel::Kind lens = LensModel::Kind::kFullOpenCv) {
  TruthOptions options;
  options.lens = lens;
  options.images = images;
  options.centre = {100, -200, 30};
  return MakeTruthBlock(options);
}

TEST(ColmapBlock, ReadsWhatWasWritten) {
  using Kind = LensModel::Kind;
  for (const Kind kind : {Kind::kPinhole, Kind::kOpenCv, Kind::kFullOpenCv}) {
    const ImportedBlock truth = ColmapTruth(9, kind);
    StatusOr<TempFolder> folder = TempFolder::Create("");
    ASSERT_TRUE(folder.ok());
    ASSERT_TRUE(WriteColmapBlock(truth, folder->path()).ok());
    Warnings warnings;
    const StatusOr<ImportedBlock> block = ReadBlock(folder->path(), std::nullopt, {}, &warnings);
    ASSERT_TRUE(block.ok()) << block.status();
    EXPECT_EQ(block->format, "colmap");
    EXPECT_EQ(block->version, "text");
    EXPECT_THAT(block->files, ElementsAre(folder->path() + "/cameras.txt", folder->path() + "/images.txt",
                                          folder->path() + "/points3D.txt"));
    const NamedBlockErrors errors = CompareByName(*block, truth);
    EXPECT_EQ(errors.images, truth.images.size());
    EXPECT_EQ(errors.observations, ObservationsOf(truth));
    EXPECT_LT(errors.centre, 1e-9);
    EXPECT_LT(errors.rotation, 1e-9);
    EXPECT_LT(errors.reprojection_px, 1e-6);
    EXPECT_LT(errors.observation_px, 1e-9);
  }
}

TEST(ColmapBlock, ReadsTheModelWithMostImagesOrTheComponentOfTheOption) {
  StatusOr<TempFolder> folder = TempFolder::Create("");
  ASSERT_TRUE(folder.ok());
  ASSERT_TRUE(WriteColmapBlock(ColmapTruth(5), folder->path() + "/sparse/0").ok());
  ASSERT_TRUE(WriteColmapBlock(ColmapTruth(9), folder->path() + "/sparse/1").ok());
  Warnings warnings;
  StatusOr<ImportedBlock> block = ReadBlock(folder->path(), std::nullopt, {}, &warnings);
  ASSERT_TRUE(block.ok()) << block.status();
  EXPECT_EQ(block->images.size(), 9u);
  EXPECT_THAT(block->files, testing::Contains(folder->path() + "/sparse/1/points3D.txt"));
  EXPECT_THAT(absl::StrJoin(warnings, "\n"), HasSubstr("sparse/0 (5 images)"));
  BlockReadOptions options;
  options.component = 0;
  block = ReadBlock(folder->path(), std::nullopt, options, &warnings);
  ASSERT_TRUE(block.ok()) << block.status();
  EXPECT_EQ(block->images.size(), 5u);
  options.component = 2;
  EXPECT_THAT(ReadBlock(folder->path(), std::nullopt, options, &warnings).status().message(),
              HasSubstr("--component: found 2"));
}

TEST(ColmapBlock, LeavesOutPointsInOneImageAndReportsFaults) {
  ImportedBlock truth = ColmapTruth();
  truth.points[4].observations.resize(1);
  StatusOr<TempFolder> folder = TempFolder::Create("");
  ASSERT_TRUE(folder.ok());
  ASSERT_TRUE(WriteColmapBlock(truth, folder->path()).ok());
  Warnings warnings;
  const StatusOr<ImportedBlock> block = ReadBlock(folder->path(), std::nullopt, {}, &warnings);
  ASSERT_TRUE(block.ok()) << block.status();
  EXPECT_EQ(block->points.size(), truth.points.size() - 1);
  EXPECT_THAT(block->left_out, ElementsAre("1 points in fewer than two images"));
  ASSERT_TRUE(WriteFileAtomic(folder->path() + "/cameras.txt", "1 FISHEYE 4 3 1\n").ok());
  const absl::Status status = ReadBlock(folder->path(), std::nullopt, {}, &warnings).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(status.message(), HasSubstr("cameras.txt"));
}

}  // namespace
}  // namespace tessera
