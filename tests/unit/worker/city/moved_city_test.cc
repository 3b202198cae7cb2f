#include "worker/city/moved_city.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

#include "common/storage/files.h"

namespace tessera {
namespace {

using testing::ElementsAreArray;
using testing::HasSubstr;

class MovedCityTest : public testing::Test {
 protected:
  MovedCityTest() {
    const MovedSpans moved = {positions_, labels_, confidence_, boxes_, {{0, "{\"a\":1}"}, {12, "{}"}}};
    EXPECT_TRUE(WriteMovedCity(path_, moved).ok());
  }

  const std::string path_ = testing::TempDir() + "/moved.arrays";
  const std::vector<Eigen::Vector3d> positions_ = {{1, 2, 3}, {0.1, -5, 1e9}, {0, 0, 0}, {4, 4, 4}};
  const std::vector<int32_t> labels_ = {3, -1};
  const std::vector<float> confidence_ = {0.5f, 0};
  const std::vector<Eigen::AlignedBox3d> boxes_ = {{Eigen::Vector3d(-1, 2, 3), Eigen::Vector3d(4, 5, 6)},
                                                   {Eigen::Vector3d(0, 0, 7), Eigen::Vector3d(1, 0, 8)}};
};

TEST_F(MovedCityTest, ReadsWhatWasWritten) {
  const auto moved = MovedCity::Open(path_, 4, 2, 2);
  ASSERT_TRUE(moved.ok()) << moved.status();
  EXPECT_THAT(moved->spans().positions, ElementsAreArray(positions_));
  EXPECT_THAT(moved->spans().labels, ElementsAreArray(labels_));
  EXPECT_THAT(moved->spans().confidence, ElementsAreArray(confidence_));
  ASSERT_EQ(moved->spans().cell_boxes.size(), boxes_.size());
  for (size_t c = 0; c < boxes_.size(); ++c) {
    EXPECT_EQ(moved->spans().cell_boxes[c].min(), boxes_[c].min());
    EXPECT_EQ(moved->spans().cell_boxes[c].max(), boxes_[c].max());
  }
  EXPECT_EQ(moved->ReportOf(0), "{\"a\":1}");
  EXPECT_EQ(moved->ReportOf(12), "{}");
  EXPECT_EQ(moved->ReportOf(3), "{}") << "a tile that the coarse part did not have";
}

TEST_F(MovedCityTest, FileOfAnotherCityIsRefused) {
  EXPECT_EQ(MovedCity::Open(path_, 5, 2, 2).status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(MovedCity::Open(path_, 4, 1, 2).status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(MovedCity::Open(path_, 4, 2, 3).status().code(), absl::StatusCode::kDataLoss);
}

TEST_F(MovedCityTest, EveryDamagedByteIsFound) {
  const std::string good = *ReadFile(path_);
  for (size_t at = 0; at < good.size(); at += 7) {
    std::string bad = good;
    bad[at] = static_cast<char>(bad[at] ^ 0x41);
    ASSERT_TRUE(WriteFileAtomic(path_, bad).ok());
    const auto moved = MovedCity::Open(path_, 4, 2, 2);
    ASSERT_FALSE(moved.ok()) << at;
    EXPECT_THAT(std::string(moved.status().message()), HasSubstr("moved.arrays")) << at;
  }
}

}  // namespace
}  // namespace tessera
