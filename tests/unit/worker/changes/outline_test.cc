#include "worker/changes/outline.h"

#include <gtest/gtest.h>

#include <queue>
#include <set>

#include "common/base/random.h"

namespace tessera {
namespace {

double Area(const Outline& outline) {
  double area = SignedArea(outline.outer);
  for (const Ring& hole : outline.holes) area += SignedArea(hole);
  return area;
}

TEST(Outline, OfASquareHasFourCorners) {
  const Outline outline = TraceOutline({{3, 4}, {4, 4}, {3, 5}, {4, 5}});
  ASSERT_EQ(outline.outer.size(), 4u);
  EXPECT_TRUE(outline.holes.empty());
  EXPECT_EQ(SignedArea(outline.outer), 4);
  const std::set<std::pair<double, double>> corners = {{3, 4}, {5, 4}, {5, 6}, {3, 6}};
  for (const Eigen::Vector2d& p : outline.outer) EXPECT_TRUE(corners.count({p.x(), p.y()}));
}

TEST(Outline, SupportsHolesAndCellsThatTouchAtCorners) {
  // A ring of cells around two holes that touch at a corner, and a gap at the border that touches the outside at a
  // corner.
  std::vector<Eigen::Vector2i> cells;
  const std::set<std::pair<int, int>> gaps = {{1, 1}, {2, 2}, {0, 3}};
  for (int y = 0; y < 5; ++y) {
    for (int x = 0; x < 5; ++x) {
      if (!gaps.count({x, y})) cells.emplace_back(x, y);
    }
  }
  const Outline outline = TraceOutline(cells);
  EXPECT_EQ(Area(outline), 22);
  ASSERT_EQ(outline.holes.size(), 1u);
  EXPECT_EQ(SignedArea(outline.holes[0]), -2);
}

TEST(Outline, EnclosesExactlyTheCells) {
  Random random(5);
  for (int round = 0; round < 200; ++round) {
    std::set<std::pair<int, int>> set;
    for (int y = 0; y < 9; ++y) {
      for (int x = 0; x < 9; ++x) {
        if (random.Uniform(0, 1) < 0.65) set.insert({x, y});
      }
    }
    if (set.empty()) continue;
    // The connected component of the first cell.
    std::vector<Eigen::Vector2i> cells;
    std::queue<std::pair<int, int>> next;
    next.push(*set.begin());
    set.erase(set.begin());
    while (!next.empty()) {
      const auto [x, y] = next.front();
      next.pop();
      cells.emplace_back(x, y);
      for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
        if (set.erase({x + dx, y + dy})) next.push({x + dx, y + dy});
      }
    }
    const Outline outline = TraceOutline(cells);
    EXPECT_EQ(Area(outline), static_cast<double>(cells.size()));
    EXPECT_GT(SignedArea(outline.outer), 0);
    for (const Ring& hole : outline.holes) EXPECT_LT(SignedArea(hole), 0);
  }
}

TEST(SimplifyRing, TurnsStairsIntoALine) {
  std::vector<Eigen::Vector2i> cells;
  for (int y = 0; y < 20; ++y) {
    for (int x = 0; x <= y; ++x) cells.emplace_back(x, y);
  }
  const Ring ring = TraceOutline(cells).outer;
  const Ring simple = SimplifyRing(ring, 0.75);
  EXPECT_GT(ring.size(), 30u);
  EXPECT_LE(simple.size(), 6u);
  EXPECT_NEAR(SignedArea(simple), SignedArea(ring), 0.06 * SignedArea(ring));
  EXPECT_EQ(SimplifyRing(ring, 0).size(), ring.size());
}

}  // namespace
}  // namespace tessera
