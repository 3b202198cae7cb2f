#include "worker/photo/reference_strip.h"

#include <algorithm>

#define HWY_DISABLED_TARGETS HWY_SSSE3
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "worker/photo/reference_strip.cc"
#include <hwy/foreach_target.h>
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace tessera {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// Fills one row. The face map row must be readable in whole blocks.
void FillRow(const PinholeCamera& k, const uint16_t* luminance, const int32_t* faces, const float* depth,
             const float* offset, int x0, int y0, int y, int begin, int end, ReferenceStrip* strip) {
  const hn::ScalableTag<float> d;
  const hn::RebindToSigned<decltype(d)> di;
  const hn::Rebind<uint16_t, decltype(d)> d16;
  const float ry = static_cast<float>((y0 + y + 0.5 - k.cy) / k.fy);
  const auto ray_y = hn::Set(d, 1 + ry * ry), limit = hn::Set(d, -kMinRayCosine), one = hn::Set(d, 1.0f);
  const auto per_pixel = hn::Set(d, static_cast<float>(1 / k.fx));
  const auto ramp = hn::Iota(d, static_cast<float>(0.5 - k.cx));
  float* out_depth = strip->depth.row(y);
  float* out_factor = strip->depth_factor.row(y);
  for (int x = begin; x < end; x += static_cast<int>(hn::Lanes(d))) {
    const auto face = hn::LoadU(di, faces + (x - begin));
    const auto seen = hn::Gt(face, hn::Set(di, -1));
    const auto z = hn::LoadU(d, depth + (x - begin));
    hn::StoreU(z, d, out_depth + x);
    if (hn::AllFalse(di, seen)) {
      hn::StoreU(hn::Zero(d), d, out_factor + x);
      continue;
    }
    const auto h = hn::GatherIndex(d, offset, hn::IfThenElseZero(seen, face));
    const auto rx = hn::Mul(hn::Add(ramp, hn::Set(d, static_cast<float>(x0 + x))), per_pixel);
    const auto ray = hn::Sqrt(hn::MulAdd(rx, rx, ray_y));
    const auto lit = hn::Gt(hn::PromoteTo(di, hn::LoadU(d16, luminance + x)), hn::Zero(di));
    const auto used = hn::And(hn::RebindMask(d, hn::And(seen, lit)), hn::Lt(h, hn::Mul(hn::Mul(limit, z), ray)));
    hn::StoreU(hn::IfThenElseZero(used, hn::Div(z, hn::IfThenElse(used, h, one))), d, out_factor + x);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace tessera
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace tessera {
HWY_EXPORT(FillRow);

void ReferenceStrip::Reset(int width, int height, int radius, int new_row_begin, int new_row_end) {
  row_begin = new_row_begin;
  row_end = new_row_end;
  const auto rows_within = [&](int margin, PaddedPlane& plane) {
    const int first = std::max(0, row_begin - margin);
    plane.Reset(width, first, std::min(height, row_end + margin) - first);
  };
  for (PaddedPlane* plane : {&depth, &depth_factor}) rows_within(2 * radius, *plane);
  for (PaddedPlane* plane : {&inverse_weight, &mean, &variance}) rows_within(radius, *plane);
  for (PaddedPlane* plane : {&gradient, &curvature, &count}) {
    rows_within(0, *plane);
    plane->Clear();
  }
}

void FillStrip(const PinholeCamera& camera, const Texels& texels, const FaceMap& map, const float* offset,
               ReferenceStrip* strip) {
  const int whole = map.width / kPixelBlock * kPixelBlock, tail = map.width - whole;
  for (int y = strip->depth.first_row; y < strip->depth.first_row + strip->depth.rows; ++y) {
    const uint16_t* luminance = texels.luminance.data() + texels.Index(0, y);
    const int32_t* faces = map.face.data() + static_cast<size_t>(y) * map.width;
    const float* depth = map.depth.data() + static_cast<size_t>(y) * map.width;
    HWY_DYNAMIC_DISPATCH(FillRow)
    (camera, luminance, faces, depth, offset, texels.x0, texels.y0, y, 0, whole, strip);
    int32_t last_faces[kPixelBlock];
    float last_depth[kPixelBlock] = {};
    std::fill_n(last_faces, kPixelBlock, -1);
    std::copy_n(faces + whole, tail, last_faces);
    std::copy_n(depth + whole, tail, last_depth);
    HWY_DYNAMIC_DISPATCH(FillRow)
    (camera, luminance, last_faces, last_depth, offset, texels.x0, texels.y0, y, whole, whole + kPixelBlock, strip);
    std::fill(strip->depth_factor.row(y) + whole + kPixelBlock, strip->depth_factor.row(y) + strip->depth_factor.stride,
              0.0f);
  }
}

}  // namespace tessera
#endif  // HWY_ONCE
