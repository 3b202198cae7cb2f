// Photographs of blocks are found, lenses shared, rotations checked.
#include "common/blocks/photograph_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "tests/support/blocks/write_image_header.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::HasSubstr;

TEST(BlockEntriesTest, FindsPhotographsByTheLongestCommonTail) {
  const std::string folder = FreshTestFolder("entries"), block = folder + "/block", images = folder + "/images";
  WriteImageHeader(block + "/here.png", 30, 20);
  WriteImageHeader(block + "/sub/tail.png", 31, 20);
  WriteImageHeader(images + "/day1/a/x.png", 32, 20);
  WriteImageHeader(images + "/day1/b/x.png", 33, 20);
  WriteImageHeader(images + "/day2/b/x.png", 34, 20);
  WriteImageHeader(images + "/day2/b/here.png", 35, 20);
  PhotographFiles without(block, ""), with(block, images);
  const auto width = [](PhotographFiles& files, const std::string& path) {
    const StatusOr<ImageSize> size = files.SizeOf(path);
    return size.ok() ? size->width : -static_cast<int>(size.status().code());
  };
  constexpr int kNotFound = -static_cast<int>(absl::StatusCode::kNotFound);
  constexpr int kInvalid = -static_cast<int>(absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(width(without, "here.png"), 30);
  EXPECT_EQ(width(without, block + "/here.png"), 30);
  EXPECT_EQ(width(without, "sub\\tail.png"), 31);
  EXPECT_EQ(width(without, "D:\\flight\\sub\\tail.png"), 31);
  EXPECT_EQ(width(without, "tail.png"), kNotFound);
  EXPECT_EQ(width(without, ""), kNotFound);
  EXPECT_EQ(width(without, "C:\\day1\\a\\x.png"), kNotFound);
  EXPECT_EQ(width(with, "C:\\day1\\a\\x.png"), 32);
  EXPECT_EQ(width(with, "/elsewhere/day2/b/x.png"), 34);
  EXPECT_EQ(width(with, "D:\\other\\a\\x.png"), 32);
  EXPECT_EQ(width(with, "D:\\other\\b\\x.png"), kInvalid);
  EXPECT_THAT(std::string(with.Find("b/x.png").status().message()), HasSubstr("day1/b/x.png, day2/b/x.png"));
  EXPECT_EQ(width(with, "D:\\flight\\sub\\tail.png"), 31);  // beside the block
}

TEST(BlockEntriesTest, LensesAreTheSimplestOfColmaps) {
  using Kind = LensModel::Kind;
  const PinholeCamera square{400, 300, 500, 500, 200, 150}, flat{400, 300, 500, 501, 200, 150};
  EXPECT_EQ(BrownLens(square, {}, 0, 0).kind, Kind::kPinhole);
  EXPECT_EQ(BrownLens(square, {1, 0, 0, 0}, 0, 0).kind, Kind::kSimpleRadial);
  EXPECT_EQ(BrownLens(square, {1, 2, 0, 0}, 0, 0).kind, Kind::kRadial);
  EXPECT_EQ(BrownLens(square, {0, 2, 0, 0}, 0, 0).kind, Kind::kRadial);
  EXPECT_EQ(BrownLens(flat, {1, 2, 0, 0}, 0, 0).kind, Kind::kOpenCv);
  EXPECT_EQ(BrownLens(square, {1, 2, 0, 0}, 0, 4).kind, Kind::kOpenCv);
  EXPECT_EQ(BrownLens(square, {0, 0, 3, 0}, 0, 0).kind, Kind::kFullOpenCv);
  EXPECT_EQ(BrownLens(square, {0, 0, 0, 4}, 0, 0).kind, Kind::kBrown);
  EXPECT_EQ(BrownLens(square, {}, 0, 0, 5).kind, Kind::kBrown);
  const LensModel lens = BrownLens(square, {1, 2, 3, 4}, 5, 6, 7);
  const double expected[8] = {1, 2, 5, 6, 3, 4, 7, 0};
  for (int k = 0; k < 8; ++k) EXPECT_EQ(lens.coefficients[k], expected[k]) << k;

  ImportedBlock block;
  SharedCameras cameras(&block);
  EXPECT_EQ(cameras.IndexOf(lens, "a"), 0);
  EXPECT_EQ(cameras.IndexOf(BrownLens(flat, {}, 0, 0), "b"), 1);
  EXPECT_EQ(cameras.IndexOf(lens, "c"), 0);
  EXPECT_EQ(block.cameras.size(), 2u);
}

TEST(BlockEntriesTest, RotationsAreOrthonormal) {
  const Eigen::Matrix3d rotation = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  Eigen::Matrix3d matrix = rotation;
  matrix(0, 1) += 4e-4;
  ASSERT_TRUE(MakeRotation(matrix));
  EXPECT_LT((matrix * matrix.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_LT((matrix - rotation).cwiseAbs().maxCoeff(), 4e-4);
  for (const double off : {2e-3, std::nan("")}) {
    matrix = rotation;
    matrix(1, 1) += off;
    EXPECT_FALSE(MakeRotation(matrix)) << off;
  }
  matrix = -rotation;
  EXPECT_FALSE(MakeRotation(matrix)) << "a mirror";
}

}  // namespace
}  // namespace tessera
