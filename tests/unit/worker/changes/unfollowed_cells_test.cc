#include "worker/changes/unfollowed_cells.h"

#include <gtest/gtest.h>

namespace tessera {
namespace {

TEST(UnfollowedCells, ContainUnfollowedAreasAndAdjacentCells) {
  std::vector<ChangeArea> areas(4);
  areas[0].cells = {{-4, 2}};  // followed not set
  areas[1].cells = {{0, 2}};
  areas[1].followed = true;
  areas[2].cells = {{4, 2}};
  areas[3].cells = {{5, 2}, {9, 4}};
  areas[2].followed = areas[3].followed = false;
  const UnfollowedCells cells({-6, 0, 10, 5}, areas);
  for (int y = 1; y <= 3; ++y) {
    for (int x = -5; x <= 2; ++x) EXPECT_EQ(cells.AreaOf({x, y}), -1) << x << " " << y;
    EXPECT_EQ(cells.AreaOf({3, y}), 2);
    EXPECT_EQ(cells.AreaOf({6, y}), 3);
    EXPECT_EQ(cells.AreaOf({7, y}), -1);
  }
  EXPECT_EQ(cells.AreaOf({4, 2}), 2);
  EXPECT_EQ(cells.AreaOf({5, 2}), 3) << "an area's own cell is no other's rim";
  EXPECT_EQ(cells.AreaOf({8, 3}), 3);
  EXPECT_EQ(cells.AreaOf({10, 4}), -1) << "outside";
  EXPECT_EQ(cells.AreaOf({9, 5}), -1);
  EXPECT_TRUE(cells.AnyIn({3, 3, 4, 4}));
  EXPECT_FALSE(cells.AnyIn({-6, 0, 3, 5}));
}

}  // namespace
}  // namespace tessera
