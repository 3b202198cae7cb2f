#include "worker/visibility/box_kernel.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "common/base/random.h"

namespace tessera {
namespace {

using Eigen::AlignedBox3d;
using Eigen::Vector3d;

constexpr double kNear_m = 0.5;

// A camera at the origin that looks along +z, turned a little.
CameraWindow RandomView(Random& random) {
  PosedCamera camera;
  camera.intrinsics = {200, 150, 150, 140, 100, 75};
  camera.rotation_cam_from_world = (Eigen::AngleAxisd(random.Uniform(-0.5, 0.5), Vector3d::UnitX()) *
                                    Eigen::AngleAxisd(random.Uniform(-0.5, 0.5), Vector3d::UnitY()) *
                                    Eigen::AngleAxisd(random.Uniform(0, 6), Vector3d::UnitZ()))
                                       .toRotationMatrix();
  camera.translation_cam_from_world = {random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(-1, 1)};
  return {camera, {static_cast<int>(random.Below(60)), static_cast<int>(random.Below(40)), 180, 150}};
}

std::vector<AlignedBox3d> RandomBoxes(Random& random, int count) {
  std::vector<AlignedBox3d> boxes;
  for (int i = 0; i < count; ++i) {
    AlignedBox3d& box = boxes.emplace_back();
    if (i % 7 == 3) continue;  // empty
    const Vector3d low(random.Uniform(-8, 8), random.Uniform(-8, 8), random.Uniform(-4, 12));
    box = {low, low + Vector3d(random.Uniform(0, 3), random.Uniform(0, 3), random.Uniform(0, 3))};
  }
  return boxes;
}

std::vector<PixelRect> Bounds(const CameraWindow& view, const std::vector<AlignedBox3d>& boxes) {
  std::vector<PixelRect> rects(boxes.size());
  BoundPixels(view, boxes, kNear_m, rects);
  return rects;
}

TEST(BoundPixels, HoldsTheCornersAndNoMoreThanTheirRounding) {
  int inside = 0, cut = 0, behind = 0, outside = 0;
  for (uint64_t seed = 0; seed < 40; ++seed) {
    Random random(seed);
    const CameraWindow view = RandomView(random);
    const PixelRect& window = view.rect;
    // Numbers of boxes that fill vectors and that do not.
    const std::vector<AlignedBox3d> boxes = RandomBoxes(random, 1 + static_cast<int>(seed));
    const std::vector<PixelRect> rects = Bounds(view, boxes);
    for (size_t i = 0; i < boxes.size(); ++i) {
      if (boxes[i].isEmpty()) {
        EXPECT_EQ(rects[i], PixelRect());
        continue;
      }
      Vector3d low = Vector3d::Constant(1e9), high = -low;
      int in_front = 0;
      for (int c = 0; c < 8; ++c) {
        const Vector3d corner = boxes[i].corner(static_cast<AlignedBox3d::CornerType>(c));
        const Vector3d pixel = view.camera.Project(corner);
        if (!(pixel.z() >= kNear_m)) continue;
        ++in_front;
        low = low.cwiseMin(pixel);
        high = high.cwiseMax(pixel);
      }
      if (in_front == 0) {
        ++behind;
        EXPECT_EQ(rects[i], PixelRect());
      } else if (in_front < 8) {
        ++cut;
        EXPECT_EQ(rects[i], window);
      } else if (low.x() >= window.x1 + 3 || low.y() >= window.y1 + 3 || high.x() < window.x0 - 3 ||
                 high.y() < window.y0 - 3) {
        ++outside;
        EXPECT_TRUE(rects[i].empty());
      } else {
        ++inside;
        // The rasteriser moves corners by less than a pixel.
        const PixelRect& rect = rects[i];
        EXPECT_TRUE(rect.x0 == window.x0 || (rect.x0 <= low.x() - 1 && rect.x0 > low.x() - 4));
        EXPECT_TRUE(rect.y0 == window.y0 || (rect.y0 <= low.y() - 1 && rect.y0 > low.y() - 4));
        EXPECT_TRUE(rect.x1 == window.x1 || (rect.x1 >= high.x() + 1 && rect.x1 < high.x() + 4));
        EXPECT_TRUE(rect.y1 == window.y1 || (rect.y1 >= high.y() + 1 && rect.y1 < high.y() + 4));
      }
    }
  }
  EXPECT_GT(inside, 30);
  EXPECT_GT(cut, 30);
  EXPECT_GT(behind, 30);
  EXPECT_GT(outside, 30);
}

TEST(BoundPixels, ResultIsIndependentOfTheInstructionSet) {
  Random random(50);
  const CameraWindow view = RandomView(random);
  const std::vector<AlignedBox3d> boxes = RandomBoxes(random, 101);
  const std::vector<PixelRect> best = Bounds(view, boxes);
  int tried = 0;
  for (int64_t target : {HWY_SCALAR, HWY_SSSE3, HWY_SSE4, HWY_AVX2}) {
    if (target != HWY_SCALAR && (hwy::SupportedTargets() & target) == 0) continue;
    hwy::GetChosenTarget().Update(target);
    EXPECT_EQ(Bounds(view, boxes), best) << hwy::TargetName(target);
    ++tried;
  }
  hwy::GetChosenTarget().DeInit();  // the next call chooses again
  EXPECT_GT(tried, 1);
}

}  // namespace
}  // namespace tessera
