// Lenses are shared and rotations checked.
#include "common/blocks/block_parts.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

namespace tessera {
namespace {

TEST(BlockPartsTest, LensesAreTheSimplestOfColmaps) {
  using Kind = LensModel::Kind;
  const PinholeCamera square{400, 300, 500, 500, 200, 150}, flat{400, 300, 500, 501, 200, 150};
  EXPECT_EQ(MakeBrownLens(square, {}, 0, 0).kind, Kind::kPinhole);
  EXPECT_EQ(MakeBrownLens(square, {1, 0, 0, 0}, 0, 0).kind, Kind::kSimpleRadial);
  EXPECT_EQ(MakeBrownLens(square, {1, 2, 0, 0}, 0, 0).kind, Kind::kRadial);
  EXPECT_EQ(MakeBrownLens(square, {0, 2, 0, 0}, 0, 0).kind, Kind::kRadial);
  EXPECT_EQ(MakeBrownLens(flat, {1, 2, 0, 0}, 0, 0).kind, Kind::kOpenCv);
  EXPECT_EQ(MakeBrownLens(square, {1, 2, 0, 0}, 0, 4).kind, Kind::kOpenCv);
  EXPECT_EQ(MakeBrownLens(square, {0, 0, 3, 0}, 0, 0).kind, Kind::kFullOpenCv);
  EXPECT_EQ(MakeBrownLens(square, {0, 0, 0, 4}, 0, 0).kind, Kind::kBrown);
  EXPECT_EQ(MakeBrownLens(square, {}, 0, 0, 5).kind, Kind::kBrown);
  const LensModel lens = MakeBrownLens(square, {1, 2, 3, 4}, 5, 6, 7);
  const double expected[8] = {1, 2, 5, 6, 3, 4, 7, 0};
  for (int k = 0; k < 8; ++k) EXPECT_EQ(lens.coefficients[k], expected[k]) << k;

  ImportedBlock block;
  SharedCameras cameras(&block);
  EXPECT_EQ(cameras.IndexOf(lens, "a"), 0);
  EXPECT_EQ(cameras.IndexOf(MakeBrownLens(flat, {}, 0, 0), "b"), 1);
  EXPECT_EQ(cameras.IndexOf(lens, "c"), 0);
  EXPECT_EQ(block.cameras.size(), 2u);
}

TEST(BlockPartsTest, RotationsAreOrthonormal) {
  const Eigen::Matrix3d rotation = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  Eigen::Matrix3d matrix = rotation;
  matrix(0, 1) += 4e-4;
  ASSERT_TRUE(MakeRotation(&matrix));
  EXPECT_LT((matrix * matrix.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_LT((matrix - rotation).cwiseAbs().maxCoeff(), 4e-4);
  for (const double off : {2e-3, std::nan("")}) {
    matrix = rotation;
    matrix(1, 1) += off;
    EXPECT_FALSE(MakeRotation(&matrix)) << off;
  }
  matrix = -rotation;
  EXPECT_FALSE(MakeRotation(&matrix)) << "a mirror";
}

}  // namespace
}  // namespace tessera
