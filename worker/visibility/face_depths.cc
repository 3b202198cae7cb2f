#include "worker/visibility/face_depths.h"

#include <algorithm>
#include <cmath>

#define HWY_DISABLED_TARGETS (HWY_AVX3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "worker/visibility/face_depths.cc"
#include <hwy/foreach_target.h>
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace tessera {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Doubles = hn::CappedTag<double, 4>;
using Ints = hn::Rebind<int32_t, Doubles>;
using Floats = hn::Rebind<float, Doubles>;
constexpr int kMaxLanes = 4;

// Depths of the row's pixels [x, x + count), count at most the lanes. Returns the pixels, as bits, whose faces are not
// for the grid's arithmetic; their depths stay.
HWY_INLINE uint32_t UpdateWindow(const Triangle* faces, const GridVertex* vertices, const int32_t* ids, int x, int y,
                                 int count, float* depth) {
  const Doubles d;
  const Ints di;
  const Floats df;
  alignas(16) GridVertex corners[3][kMaxLanes];
  alignas(16) float old[kMaxLanes] = {};
  bool any = false;
  for (int lane = 0; lane < count; ++lane) any = any || ids[lane] >= 0;
  if (!any) return 0;
  for (int lane = 0; lane < static_cast<int>(hn::Lanes(d)); ++lane) {
    const int32_t id = lane < count ? std::max(ids[lane], 0) : 0;
    for (int c = 0; c < 3; ++c) corners[c][lane] = vertices[faces[id][c]];
    if (lane < count) old[lane] = depth[lane];
  }
  hn::Vec<Doubles> px[3], py[3], z[3];
  auto off = hn::Zero(di);
  const auto xc = hn::Add(hn::Mul(hn::Iota(d, 0), hn::Set(d, static_cast<double>(kGridPerPixel))),
                          hn::Set(d, static_cast<double>(x * kGridPerPixel + kGridHalf)));
  const auto yc = hn::Set(d, static_cast<double>(y * kGridPerPixel + kGridHalf));
  auto extent = hn::Zero(d);
  for (int c = 0; c < 3; ++c) {
    hn::Vec<Ints> gx, gy, iz, off_grid;
    hn::LoadInterleaved4(di, reinterpret_cast<const int32_t*>(corners[c]), gx, gy, iz, off_grid);
    px[c] = hn::Sub(hn::PromoteTo(d, gx), xc);
    py[c] = hn::Sub(hn::PromoteTo(d, gy), yc);
    z[c] = hn::PromoteTo(d, hn::BitCast(df, iz));
    off = hn::Or(off, off_grid);
    extent = hn::Max(extent, hn::Max(hn::Abs(px[c]), hn::Abs(py[c])));
  }
  const auto area_a = hn::Sub(hn::Mul(px[1], py[2]), hn::Mul(py[1], px[2]));
  const auto area_b = hn::Sub(hn::Mul(px[2], py[0]), hn::Mul(py[2], px[0]));
  const auto area_c = hn::Sub(hn::Mul(px[0], py[1]), hn::Mul(py[0], px[1]));
  const auto total = hn::Add(hn::Add(area_a, area_b), area_c);
  const auto one = hn::Set(d, 1.0);
  const auto flat = hn::Eq(total, hn::Zero(d));
  const auto divisor = hn::IfThenElse(flat, one, total);
  const auto for_b = hn::Div(hn::Sub(z[1], z[0]), divisor), for_c = hn::Div(hn::Sub(z[2], z[0]), divisor);
  const auto plane = hn::Add(z[0], hn::Add(hn::Mul(area_b, for_b), hn::Mul(area_c, for_c)));
  const auto kept = hn::Div(one, hn::PromoteTo(d, hn::Load(df, old)));
  const auto low = hn::Min(hn::Min(z[0], z[1]), z[2]), high = hn::Max(hn::Max(z[0], z[1]), z[2]);
  const auto inverse = hn::DemoteTo(df, hn::Min(hn::Max(hn::IfThenElse(flat, kept, plane), low), high));
  alignas(16) float updated[kMaxLanes];
  alignas(16) int32_t is_off[kMaxLanes];
  alignas(32) double extents[kMaxLanes];
  hn::Store(hn::Div(hn::Set(df, 1.0f), inverse), df, updated);
  hn::Store(off, di, is_off);
  hn::Store(extent, d, extents);
  uint32_t rest = 0;
  for (int lane = 0; lane < count; ++lane) {
    if (ids[lane] < 0) continue;
    // Products of such numbers and their sums are exact.
    if (is_off[lane] != 0 || extents[lane] >= (1 << 25)) {
      rest |= 1u << lane;
    } else {
      depth[lane] = updated[lane];
    }
  }
  return rest;
}

// By the plane in space, for faces across the near plane or thousands of pixels large.
float UnboundedDepth(const TriangleMesh& mesh, const PosedCamera& camera, uint32_t f, int x, int y, float old) {
  const PinholeCamera& k = camera.intrinsics;
  const Eigen::Vector3d a = camera.CameraFromWorld(mesh.Corner(f, 0)), b = camera.CameraFromWorld(mesh.Corner(f, 1)),
                        c = camera.CameraFromWorld(mesh.Corner(f, 2));
  const Eigen::Vector3d normal = (b - a).cross(c - a), ray((x + 0.5 - k.cx) / k.fx, (y + 0.5 - k.cy) / k.fy, 1);
  const double z = normal.dot(a) / normal.dot(ray);
  if (!(z > 0) || !std::isfinite(z)) return old;
  return static_cast<float>(std::clamp(z, std::min({a.z(), b.z(), c.z()}), std::max({a.z(), b.z(), c.z()})));
}

void Update(const TriangleMesh& mesh, const GridVertex* vertices, const PosedCamera& camera, int row_first,
            int row_last, int width, const int32_t* face, float* depth) {
  const int lanes = static_cast<int>(hn::Lanes(Doubles()));
  for (int y = row_first; y < row_last; ++y) {
    const size_t row = static_cast<size_t>(y) * width;
    for (int x = 0; x < width; x += lanes) {
      const int count = std::min(lanes, width - x);
      const size_t i = row + x;
      uint32_t rest = UpdateWindow(mesh.faces.data(), vertices, face + i, x, y, count, depth + i);
      for (int lane = 0; rest != 0; ++lane, rest >>= 1) {
        if ((rest & 1) == 0) continue;
        depth[i + lane] = UnboundedDepth(mesh, camera, face[i + lane], x + lane, y, depth[i + lane]);
      }
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace tessera
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace tessera {
HWY_EXPORT(Update);

void UpdateFaceDepths(const TriangleMesh& mesh, const GridVertex* vertices, const PosedCamera& camera, int row_first,
                      int row_last, int width, const int32_t* face, float* depth) {
  HWY_DYNAMIC_DISPATCH(Update)(mesh, vertices, camera, row_first, row_last, width, face, depth);
}

}  // namespace tessera
#endif  // HWY_ONCE
