#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "common/exporting/obj/tile_rects.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

// Tiles of 100 x 100, row by row.
std::vector<PlanRect> ObjGridRects(int columns, int rows) {
  std::vector<PlanRect> rects;
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) rects.push_back({100.0 * x, 100.0 * y, 100.0 * x + 100, 100.0 * y + 100});
  }
  return rects;
}

TEST(TileRectsTest, ARegularGridIsCutAtItsInnerLinesAndItsRimExtendsToInfinity) {
  const TileRects rects = TileRects::Of(ObjGridRects(3, 2));
  EXPECT_THAT(rects.xs(), ElementsAre(100, 200));
  EXPECT_THAT(rects.ys(), ElementsAre(100));
  EXPECT_EQ(rects.TileAt({50, 50}), 0);
  EXPECT_EQ(rects.TileAt({100, 100}), 4);  // on lines: the cell above
  EXPECT_EQ(rects.TileAt({-1e9, -1e9}), 0);
  EXPECT_EQ(rects.TileAt({1e9, 1e9}), 5);
}

TEST(TileRectsTest, MeshesThatDoNotFillTheirTilesLeaveTheGridAsItIs) {
  std::vector<PlanRect> rects = ObjGridRects(3, 3);
  rects[2] = {200, 10, 237.5, 63.25};  // the mesh ends there
  rects[6] = {71, 200, 100, 290};
  rects[4].x0 = 100.004;  // its faces were rounded or refined
  rects[3].x1 = 99.999;
  const TileRects grid = TileRects::Of(rects);
  EXPECT_THAT(grid.xs(), ElementsAre(100, 200));
  EXPECT_THAT(grid.ys(), ElementsAre(100, 200));
  EXPECT_EQ(grid.TileAt({299, 99}), 2);
  EXPECT_EQ(grid.TileAt({0, 201}), 6);
}

TEST(TileRectsTest, CellsWithoutATileGoToTheNearest) {
  std::vector<PlanRect> rects = ObjGridRects(3, 3);
  rects[4] = {};  // a hole in the middle
  rects[8] = {};
  const TileRects grid = TileRects::Of(rects);
  EXPECT_EQ(grid.TileAt({150, 150}), 1);  // four are equally near: the first
  EXPECT_EQ(grid.TileAt({250, 250}), 5);
  EXPECT_EQ(grid.TileAt({50, 250}), 6);
}

TEST(TileRectsTest, WhereRectanglesOverlapTheFirstTileOwns) {
  const std::vector<PlanRect> rects = {{0, 0, 100, 100}, {60, 40, 200, 120}, {150, 0, 260, 90}};
  const TileRects cells = TileRects::Of(rects);
  EXPECT_EQ(cells.TileAt({80, 60}), 0);
  EXPECT_EQ(cells.TileAt({120, 60}), 1);
  EXPECT_EQ(cells.TileAt({180, 60}), 1);
  EXPECT_EQ(cells.TileAt({230, 60}), 2);
  EXPECT_EQ(cells.TileAt({80, 110}), 1);
  EXPECT_EQ(cells.TileAt({-50, 50}), 0);
  EXPECT_EQ(cells.TileAt({300, 50}), 2);
}

TEST(TileRectsTest, TilesOfDifferentSizesKeepTheirRectangles) {
  const std::vector<PlanRect> rects = {{0, 0, 200, 200}, {200, 0, 300, 100}, {200, 100, 300, 200}, {300, 0, 500, 200}};
  const TileRects cells = TileRects::Of(rects);
  std::mt19937 random(7);
  std::uniform_real_distribution<double> x(0, 500), y(0, 200);
  for (int k = 0; k < 1000; ++k) {
    const Eigen::Vector2d p(x(random), y(random));
    const PlanRect& owner = rects[static_cast<size_t>(cells.TileAt(p))];
    EXPECT_TRUE(p.x() >= owner.x0 && p.x() <= owner.x1 && p.y() >= owner.y0 && p.y() <= owner.y1) << p.transpose();
  }
}

TEST(TileRectsTest, OneTileOrNoneHasNoLines) {
  for (const std::vector<PlanRect>& rects : {std::vector<PlanRect>(), std::vector<PlanRect>(3), ObjGridRects(1, 1),
                                             std::vector<PlanRect>{{}, {0, 0, 1, 1}}}) {
    const TileRects one = TileRects::Of(rects);
    EXPECT_THAT(one.xs(), IsEmpty());
    EXPECT_THAT(one.ys(), IsEmpty());
    EXPECT_EQ(one.TileAt({3, 4}), rects.size() == 2 ? 1 : 0);
  }
  const std::vector<PlanRect> same(2, PlanRect{0, 0, 1, 1});
  EXPECT_EQ(TileRects::Of(same).TileAt({3, 4}), 0);
}

TEST(TileRectsTest, ManyIrregularTilesStayWithinTheMemory) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> at(0, 1e6);
  std::vector<PlanRect> rects;
  for (int k = 0; k < 3000; ++k) {
    const double x = at(random), y = at(random);
    rects.push_back({x, y, x + 100, y + 100});
  }
  const TileRects cells = TileRects::Of(rects);
  EXPECT_LE((cells.xs().size() + 1) * (cells.ys().size() + 1), size_t{4} << 20);
}

}  // namespace
}  // namespace tessera
