#include "worker/visibility/visible_cells.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>

#include "common/base/random.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

PosedCamera RandomCamera(Random& random) {
  PosedCamera camera;
  camera.intrinsics = {200, 150, 150, 150, 100, 75};
  const double tilt = random.Uniform(-0.7, 0.7), turn = random.Uniform(0, 6);
  Eigen::Matrix3d down;
  down << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  camera.rotation_cam_from_world = Eigen::AngleAxisd(tilt, Vector3d::UnitX()).toRotationMatrix() * down *
                                   Eigen::AngleAxisd(turn, Vector3d::UnitZ()).toRotationMatrix();
  const Vector3d centre(random.Uniform(-10, 40), random.Uniform(-10, 40), random.Uniform(20, 50));
  camera.translation_cam_from_world = -(camera.rotation_cam_from_world * centre);
  return camera;
}

// A point of a box and its projection in a view.
struct Sample {
  uint32_t cell;
  Vector3d point;
};

bool Within(const Vector3d& a, const Vector3d& b, double margin) {
  return std::abs(std::floor(a.x()) - std::floor(b.x())) <= margin &&
         std::abs(std::floor(a.y()) - std::floor(b.y())) <= margin;
}

bool Holds(const PixelRect& rect, const Vector3d& p) {
  return p.x() >= rect.x0 && p.x() < rect.x1 && p.y() >= rect.y0 && p.y() < rect.y1;
}

bool Has(const std::vector<uint32_t>& cells, uint32_t cell) {
  return std::binary_search(cells.begin(), cells.end(), cell);
}

// Checks the three steps documented in the header on random points of random boxes.
TEST(FindVisibleCells, ContainsAllCellsThatOwnPixelsCanDependOn) {
  int64_t own_pixels = 0, partners = 0, left_out = 0;
  for (uint64_t seed = 0; seed < 12; ++seed) {
    Random random(seed);
    VisibleCellsProblem problem;
    std::vector<Sample> samples;
    for (uint32_t c = 0; c < 60; ++c) {
      const Vector3d low(random.Uniform(0, 30), random.Uniform(0, 30), 0);
      const Vector3d size(random.Uniform(0.5, 3), random.Uniform(0.5, 3), random.Uniform(0.1, 8));
      problem.boxes.emplace_back(low, low + size);
      for (int k = 0; k < 6; ++k) {
        samples.push_back({c, low + size.cwiseProduct(Vector3d(random.Uniform(), random.Uniform(), random.Uniform()))});
      }
    }
    constexpr int kViews = 4;
    for (int v = 0; v < kViews; ++v) {
      CameraWindow view(RandomCamera(random));
      view.rect = {static_cast<int>(random.Below(60)), static_cast<int>(random.Below(40)), 200, 150};
      problem.views.push_back(view);
      std::vector<uint32_t>& own = problem.own.emplace_back();
      for (uint32_t c = 0; c < 4 && v > 0; ++c) own.push_back(c * 7 + static_cast<uint32_t>(v));
      if (v > 0) problem.pairs.push_back({v, v - 1});
    }
    problem.reference_margin_px = 6;
    problem.target_margin_px = 1;
    const VisibleCells sight = FindVisibleCells(problem);
    const auto at = [&](int view, const Sample& s) { return problem.views[view].camera.Project(s.point); };
    const auto in_view = [&](int view, const Sample& s) {
      const Vector3d p = at(view, s);
      return p.z() >= kNearPlane_m && Holds(problem.views[view].rect, p);
    };
    for (int v = 0; v < kViews; ++v) {
      left_out += 60 - static_cast<int64_t>(sight.cells[v].size());
      EXPECT_TRUE(std::ranges::includes(sight.cells[v], sight.own_cells[v]));
      for (const Sample& own : samples) {
        if (!Has(problem.own[v], own.cell) || !in_view(v, own)) continue;
        ++own_pixels;
        EXPECT_TRUE(Holds(sight.own_windows[v], at(v, own)));
        EXPECT_TRUE(Has(sight.cells[v], own.cell));
        for (const Sample& other : samples) {
          if (!in_view(v, other) || !Within(at(v, own), at(v, other), problem.reference_margin_px)) continue;
          ASSERT_TRUE(Has(sight.cells[v], other.cell)) << "seed " << seed;
          ASSERT_TRUE(Has(sight.own_cells[v], other.cell)) << "seed " << seed;
          ASSERT_TRUE(Holds(sight.own_windows[v], at(v, other))) << "seed " << seed;
          // It may be warped to any pixel within the margin of its projection.
          if (v == 0 || !in_view(v - 1, other)) continue;
          ++partners;
          ASSERT_TRUE(Holds(sight.windows[v - 1], at(v - 1, other))) << "seed " << seed;
          for (const Sample& hiding : samples) {
            if (!in_view(v - 1, hiding) || !Within(at(v - 1, other), at(v - 1, hiding), 1)) continue;
            ASSERT_TRUE(Has(sight.cells[v - 1], hiding.cell)) << "seed " << seed;
          }
        }
      }
    }
  }
  EXPECT_GT(own_pixels, 300);
  EXPECT_GT(partners, 300);
  EXPECT_GT(left_out, 100) << "the test is void: nearly every cell is visible";
}

TEST(ForRanges, CoversEachElementOnce) {
  Random random(5);
  for (const int64_t grain : {1, 3, 50, 1000}) {
    std::vector<std::array<uint32_t, 2>> ranges;
    std::vector<std::atomic<int>> visits(2000);
    std::vector<int> expected(2000, 0);
    for (uint32_t at = 0; at < 1900;) {
      const auto first = at + static_cast<uint32_t>(random.Uniform() * 20);
      const auto last = first + static_cast<uint32_t>(random.Uniform() * 80);
      ranges.push_back({first, last});
      for (uint32_t i = first; i < last; ++i) expected[i] = 1;
      at = last;
    }
    ForRanges(ranges, grain, [&](int64_t begin, int64_t end) {
      EXPECT_LE(end - begin, grain);
      for (int64_t i = begin; i < end; ++i) ++visits[i];
    });
    for (size_t i = 0; i < expected.size(); ++i) EXPECT_EQ(visits[i], expected[i]) << i;
  }
  ForRanges({}, 10, [](int64_t, int64_t) { FAIL(); });
}

}  // namespace
}  // namespace tessera
