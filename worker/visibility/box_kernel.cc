#include "worker/visibility/box_kernel.h"

#include <algorithm>
#include <cstdint>
#include <limits>

// No gain from wider vectors.
#define HWY_DISABLED_TARGETS (HWY_AVX3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "worker/visibility/box_kernel.cc"
#include <hwy/foreach_target.h>
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace tessera {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Doubles = hn::CappedTag<double, 4>;
using Ints = hn::Rebind<int32_t, Doubles>;
constexpr int kMostLanes = 4;
constexpr double kRounding_px = 2;  // error bound of projected corners and of the rasteriser's grid

void Bound(const CameraWindow& view, const Eigen::AlignedBox3d* boxes, size_t count, double near_m, PixelRect* out) {
  const Doubles d;
  const Ints di;
  const size_t lanes = hn::Lanes(d);
  const PosedCamera& camera = view.camera;
  const PinholeCamera& k = camera.intrinsics;
  const auto infinity = hn::Set(d, std::numeric_limits<double>::infinity());
  for (size_t first = 0; first < count; first += lanes) {
    const size_t used = std::min(lanes, count - first);
    alignas(32) double lowest[3][kMostLanes] = {}, size[3][kMostLanes] = {};
    for (size_t i = 0; i < used; ++i) {
      const Eigen::AlignedBox3d& box = boxes[first + i];
      if (box.isEmpty()) continue;
      for (int axis = 0; axis < 3; ++axis) {
        lowest[axis][i] = box.min()[axis];
        size[axis][i] = box.max()[axis] - box.min()[axis];
      }
    }
    hn::Vec<Doubles> corner[3], edge[3][3];  // the lowest corner and the edges from it, in the camera's frame
    for (int r = 0; r < 3; ++r) {
      corner[r] = hn::Set(d, camera.translation_cam_from_world[r]);
      for (int axis = 0; axis < 3; ++axis) {
        const auto rotation = hn::Set(d, camera.rotation_cam_from_world(r, axis));
        corner[r] = hn::Add(corner[r], hn::Mul(rotation, hn::Load(d, lowest[axis])));
        edge[r][axis] = hn::Mul(rotation, hn::Load(d, size[axis]));
      }
    }
    auto x0 = infinity, y0 = infinity, x1 = hn::Neg(infinity), y1 = hn::Neg(infinity);
    auto in_front = hn::Zero(d);  // number of corners
    for (int c = 0; c < 8; ++c) {
      hn::Vec<Doubles> p[3] = {corner[0], corner[1], corner[2]};
      for (int axis = 0; axis < 3; ++axis) {
        if (!(c >> axis & 1)) continue;
        for (int r = 0; r < 3; ++r) p[r] = hn::Add(p[r], edge[r][axis]);
      }
      const auto front = hn::Ge(p[2], hn::Set(d, near_m));
      const auto one = hn::Set(d, 1.0), inverse = hn::Div(one, p[2]);
      const auto x = hn::Add(hn::Mul(hn::Mul(hn::Set(d, k.fx), p[0]), inverse), hn::Set(d, k.cx));
      const auto y = hn::Add(hn::Mul(hn::Mul(hn::Set(d, k.fy), p[1]), inverse), hn::Set(d, k.cy));
      x0 = hn::Min(x0, hn::IfThenElse(front, x, infinity));
      y0 = hn::Min(y0, hn::IfThenElse(front, y, infinity));
      x1 = hn::Max(x1, hn::IfThenElse(front, x, hn::Neg(infinity)));
      y1 = hn::Max(y1, hn::IfThenElse(front, y, hn::Neg(infinity)));
      in_front = hn::Add(in_front, hn::IfThenElseZero(front, one));
    }
    alignas(16) int32_t side[4][kMostLanes];
    alignas(32) double fronts[kMostLanes];
    const auto rounding = hn::Set(d, kRounding_px);
    const auto store = [&](auto pixels, int low, int high, int32_t* to) HWY_ATTR {
      const auto clamped = hn::Min(hn::Max(pixels, hn::Set(d, double(low))), hn::Set(d, double(high)));
      hn::Store(hn::DemoteTo(di, clamped), di, to);
    };
    const PixelRect& domain = view.rect;
    store(hn::Floor(hn::Sub(x0, rounding)), domain.x0, domain.x1, side[0]);
    store(hn::Floor(hn::Sub(y0, rounding)), domain.y0, domain.y1, side[1]);
    store(hn::Ceil(hn::Add(x1, rounding)), domain.x0, domain.x1, side[2]);
    store(hn::Ceil(hn::Add(y1, rounding)), domain.y0, domain.y1, side[3]);
    hn::Store(in_front, d, fronts);
    for (size_t i = 0; i < used; ++i) {
      PixelRect& rect = out[first + i];
      if (fronts[i] == 0 || boxes[first + i].isEmpty()) {
        rect = {};
      } else if (fronts[i] < 8) {
        rect = domain;
      } else {
        rect = {side[0][i], side[1][i], side[2][i], side[3][i]};
      }
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace tessera
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace tessera {
HWY_EXPORT(Bound);

void BoundPixels(const CameraWindow& view, std::span<const Eigen::AlignedBox3d> boxes, double near_m,
                 std::span<PixelRect> out) {
  if (!boxes.empty()) HWY_DYNAMIC_DISPATCH(Bound)(view, boxes.data(), boxes.size(), near_m, out.data());
}

}  // namespace tessera
#endif  // HWY_ONCE
