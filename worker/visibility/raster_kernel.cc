#include "worker/visibility/raster_kernel.h"

#include <array>

// No gain from wider vectors.
#define HWY_DISABLED_TARGETS (HWY_AVX3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "worker/visibility/raster_kernel.cc"
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
// Column by column: a row of the camera's matrix times the vertex, in the order that plain code would take.
struct Projection {
  double row[3][4];
  double x_scale, x_shift, y_scale, y_shift, near_m;
};

HWY_INLINE void ProjectLanes(const Projection& p, const double* in, int32_t* out) {
  const Doubles d;
  const Ints di;
  hn::Vec<Doubles> x, y, z;
  hn::LoadInterleaved3(d, in, x, y, z);
  const auto row = [&](int r) HWY_ATTR {
    auto sum = hn::Add(hn::Mul(hn::Set(d, p.row[r][0]), x), hn::Mul(hn::Set(d, p.row[r][1]), y));
    sum = hn::Add(sum, hn::Mul(hn::Set(d, p.row[r][2]), z));
    return hn::Add(sum, hn::Set(d, p.row[r][3]));
  };
  const auto depth = row(2);
  const auto inverse = hn::Div(hn::Set(d, 1.0), depth);
  const auto u = hn::Add(hn::Mul(hn::Mul(hn::Set(d, p.x_scale), row(0)), inverse), hn::Set(d, p.x_shift));
  const auto v = hn::Add(hn::Mul(hn::Mul(hn::Set(d, p.y_scale), row(1)), inverse), hn::Set(d, p.y_shift));
  const auto limit = hn::Set(d, kGridLimit - 1);
  const auto good = hn::And(hn::Ge(depth, hn::Set(d, p.near_m)),
                            hn::And(hn::Lt(hn::Abs(u), limit), hn::Lt(hn::Abs(v), limit)));
  const auto to_grid = [&](auto value) HWY_ATTR { return hn::DemoteTo(di, hn::Round(hn::IfThenElseZero(good, value))); };
  const auto flag = hn::DemoteTo(di, hn::IfThenZeroElse(good, hn::Set(d, -1.0)));
  const auto inverse_z = hn::BitCast(di, hn::DemoteTo(Floats(), hn::IfThenElseZero(good, inverse)));
  hn::StoreInterleaved4(to_grid(u), to_grid(v), inverse_z, flag, di, out);
}

void Project(const Eigen::Vector3d* vertices, int64_t count, const PosedCamera& camera, double near_m,
             GridVertex* out) {
  const PinholeCamera& k = camera.intrinsics;
  Projection p;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) p.row[r][c] = camera.rotation_cam_from_world(r, c);
    p.row[r][3] = camera.translation_cam_from_world[r];
  }
  p.x_scale = k.fx * kGridPerPixel;
  p.x_shift = k.cx * kGridPerPixel;
  p.y_scale = k.fy * kGridPerPixel;
  p.y_shift = k.cy * kGridPerPixel;
  p.near_m = near_m;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(Doubles()));
  const double* in = vertices->data();
  int64_t v = 0;
  for (; v + lanes <= count; v += lanes) ProjectLanes(p, in + 3 * v, reinterpret_cast<int32_t*>(out + v));
  if (v < count) {
    double tail[12] = {};
    GridVertex tail_out[4];
    std::copy(in + 3 * v, in + 3 * count, tail);
    ProjectLanes(p, tail, reinterpret_cast<int32_t*>(tail_out));
    std::copy_n(tail_out, count - v, out + v);
  }
}

// Pixels whose centre a face's bounding box holds, half-open; `extent` is the larger side of the box, grid units.
struct PixelBox {
  int x_first, y_first, x_last, y_last;
  bool off_grid;
  uint32_t extent;
};

#if HWY_TARGET == HWY_SCALAR
class BoxFinder {
 public:
  BoxFinder(int width, int height) : width_(width), height_(height) {}
  bool HoldsCentre(const GridVertex& a, const GridVertex& b, const GridVertex& c) const {
    const PixelBox box = Find(a, b, c);
    return box.off_grid || (box.x_first < box.x_last && box.y_first < box.y_last);
  }
  PixelBox Find(const GridVertex& a, const GridVertex& b, const GridVertex& c) const {
    const int32_t x_low = std::min(std::min(a.x, b.x), c.x), x_high = std::max(std::max(a.x, b.x), c.x);
    const int32_t y_low = std::min(std::min(a.y, b.y), c.y), y_high = std::max(std::max(a.y, b.y), c.y);
    return {std::max(Pixel(x_low), 0),
            std::max(Pixel(y_low), 0),
            std::min(Pixel(x_high), width_),
            std::min(Pixel(y_high), height_),
            (a.off_grid | b.off_grid | c.off_grid) != 0,
            std::max(static_cast<uint32_t>(x_high) - x_low, static_cast<uint32_t>(y_high) - y_low)};
  }

 private:
  static int Pixel(int32_t grid) { return (grid + static_cast<int32_t>(kGridHalf - 1)) >> kGridBits; }
  int width_, height_;
};
#else
// The four numbers of a GridVertex as one vector.
class BoxFinder {
  using Quad = hn::FixedTag<int32_t, 4>;
  using Vec = hn::Vec<Quad>;

 public:
  HWY_INLINE BoxFinder(int width, int height) {
    alignas(16) const int32_t size[4] = {width, height, 0, 0}, others[4] = {0, 0, -1, -1};
    size_ = hn::Load(Quad(), size);
    others_ = hn::Load(Quad(), others);
    to_centre_ = hn::Set(Quad(), static_cast<int32_t>(kGridHalf - 1));
  }
  HWY_INLINE bool HoldsCentre(const GridVertex& a, const GridVertex& b, const GridVertex& c) const {
    Vec low, high, first, last;
    Bounds(a, b, c, &low, &high, &first, &last);
    const auto held = hn::Or(hn::VecFromMask(Quad(), hn::Gt(last, first)), others_);
    return hn::AllTrue(Quad(), hn::MaskFromVec(hn::Or(held, hn::Broadcast<3>(low))));
  }
  HWY_INLINE PixelBox Find(const GridVertex& a, const GridVertex& b, const GridVertex& c) const {
    Vec low, high, first, last;
    Bounds(a, b, c, &low, &high, &first, &last);
    alignas(16) int32_t begin[4], end[4], extent[4];
    hn::Store(first, Quad(), begin);
    hn::Store(last, Quad(), end);
    hn::Store(hn::Sub(high, low), Quad(), extent);
    return {begin[0],
            begin[1],
            end[0],
            end[1],
            (a.off_grid | b.off_grid | c.off_grid) != 0,
            std::max(static_cast<uint32_t>(extent[0]), static_cast<uint32_t>(extent[1]))};
  }

 private:
  static HWY_INLINE Vec LoadVertex(const GridVertex& vertex) {
    return hn::Load(Quad(), reinterpret_cast<const int32_t*>(&vertex));
  }
  HWY_INLINE void Bounds(const GridVertex& a, const GridVertex& b, const GridVertex& c, Vec* low, Vec* high, Vec* first,
                         Vec* last) const {
    const auto va = LoadVertex(a), vb = LoadVertex(b), vc = LoadVertex(c);
    *low = hn::Min(hn::Min(va, vb), vc);
    *high = hn::Max(hn::Max(va, vb), vc);
    *first = hn::Max(hn::ShiftRight<kGridBits>(hn::Add(*low, to_centre_)), hn::Zero(Quad()));
    *last = hn::Min(hn::ShiftRight<kGridBits>(hn::Add(*high, to_centre_)), size_);
  }
  Vec size_, others_, to_centre_;
};
#endif

int64_t Select(const Triangle* faces, int64_t first, int64_t last, const GridVertex* vertices, int width, int height,
               uint32_t* list) {
  const BoxFinder boxes(width, height);
  int64_t count = 0;
  for (int64_t f = first; f < last; ++f) {
    const Triangle& face = faces[f];
    list[count] = static_cast<uint32_t>(f);
    // No branch: whether the next face holds a centre cannot be predicted.
    count += boxes.HoldsCentre(vertices[face[0]], vertices[face[1]], vertices[face[2]]);
  }
  return count;
}

// A face by its corners relative to the centre of its box's first pixel, and its edges as functions over the pixels:
// twice the area spanned with the pixel's centre, positive inside.
struct FaceSetup {
  int64_t area[3];  // with edges bc, ca, ab
  int64_t per_column[3], per_row[3];
  int64_t total;

  HWY_INLINE FaceSetup(const GridVertex& a, const GridVertex& b, const GridVertex& c, int x, int y) {
    const int64_t x0 = (int64_t{x} << kGridBits) + kGridHalf, y0 = (int64_t{y} << kGridBits) + kGridHalf;
    const int64_t px[3] = {a.x - x0, b.x - x0, c.x - x0}, py[3] = {a.y - y0, b.y - y0, c.y - y0};
    for (int i = 0; i < 3; ++i) {
      const int p = (i + 1) % 3, q = (i + 2) % 3;
      area[i] = px[p] * py[q] - py[p] * px[q];
      per_column[i] = py[p] - py[q];
      per_row[i] = px[q] - px[p];
    }
    total = area[0] + area[1] + area[2];
    if (total < 0) {
      total = -total;
      for (int i = 0; i < 3; ++i) {
        area[i] = -area[i];
        per_column[i] = -per_column[i];
        per_row[i] = -per_row[i];
      }
    }
  }
  HWY_INLINE DepthPlane Plane(const GridVertex& a, const GridVertex& b, const GridVertex& c) const {
    return DepthPlane(a.inverse_z, b.inverse_z, c.inverse_z, static_cast<double>(total));
  }
  // Of an edge through a pixel centre, the face to the right owns it; if it is level, the face below.
  HWY_INLINE int64_t Bias(int i) const {
    return per_column[i] > 0 || (per_column[i] == 0 && per_row[i] > 0) ? 0 : -1;
  }
};

// Column of the first pixel, from `begin`, where value + step·(column) >= 0, or of the first where it is not.
HWY_INLINE int Crossing(int64_t value, int64_t step, int columns) {
  // value >= 0 and step < 0: the last column inside is value / -step.
  const double estimate = static_cast<double>(value) / -static_cast<double>(step);
  int64_t column = estimate < 0 ? 0 : (estimate > columns ? columns : static_cast<int64_t>(estimate));
  while (column > 0 && (value + step * (column - 1) >= 0) == (step > 0)) --column;
  while (column < columns && (value + step * column >= 0) != (step > 0)) ++column;
  return static_cast<int>(column);
}

constexpr int kSpanColumns = 12;              // wider rows are worth a division an edge
constexpr uint32_t kLargestExtent = 1 << 25;  // areas stay below 2^53, whole numbers in double too

void DrawRows(const FaceSetup& setup, const DepthPlane& plane, const PixelBox& box, int32_t id,
              const DrawTarget& target) {
  int64_t bias[3], at[3], step[3];
  const int x0 = box.x_first, y0 = box.y_first;
  const int64_t skipped = std::max(target.row_first - y0, 0);
  for (int i = 0; i < 3; ++i) {
    bias[i] = setup.Bias(i);
    step[i] = setup.per_column[i] << kGridBits;
    at[i] = setup.area[i] + bias[i] + skipped * (setup.per_row[i] << kGridBits);
  }
  const int columns = box.x_last - x0;
  const int y1 = std::min(box.y_last, target.row_last);
  for (int y = y0 + static_cast<int>(skipped); y < y1; ++y) {
    int begin = 0, end = columns;
    if (columns > kSpanColumns) {
      for (int i = 0; i < 3; ++i) {
        if (step[i] > 0) begin = std::max(begin, Crossing(at[i], step[i], columns));
        if (step[i] < 0) end = std::min(end, Crossing(at[i], step[i], columns));
        if (step[i] == 0 && at[i] < 0) end = 0;
      }
      float* inverse_z = target.inverse_z + static_cast<size_t>(y) * target.width + x0;
      int32_t* face = target.face + static_cast<size_t>(y) * target.width + x0;
      const double b0 = static_cast<double>(at[1] - bias[1]), c0 = static_cast<double>(at[2] - bias[2]);
      const double bs = static_cast<double>(step[1]), cs = static_cast<double>(step[2]);
      for (int x = begin; x < end; ++x) {
        const float value = plane.At(b0 + x * bs, c0 + x * cs);  // exact sums: all below 2^53
        const bool nearer = value > inverse_z[x];
        inverse_z[x] = nearer ? value : inverse_z[x];
        face[x] = nearer ? id : face[x];
      }
    } else {
      int64_t e0 = at[0], e1 = at[1], e2 = at[2];
      for (int x = 0; x < columns; ++x) {
        if ((e0 | e1 | e2) >= 0) {
          target.Draw(x0 + x, y, plane.At(e1 - bias[1], e2 - bias[2]), id);
        }
        e0 += step[0];
        e1 += step[1];
        e2 += step[2];
      }
    }
    for (int i = 0; i < 3; ++i) at[i] += setup.per_row[i] << kGridBits;
  }
}

int64_t Draw(const Triangle* faces, const uint32_t* list, int64_t count, const GridVertex* vertices, bool with_ids,
             const DrawTarget& target) {
  const BoxFinder boxes(target.width, target.height);
  for (int64_t k = 0; k < count; ++k) {
    const uint32_t f = list[k];
    const GridVertex& a = vertices[faces[f][0]];
    const GridVertex& b = vertices[faces[f][1]];
    const GridVertex& c = vertices[faces[f][2]];
    const PixelBox box = boxes.Find(a, b, c);
    if (box.off_grid || box.extent >= kLargestExtent) return k;
    if (box.y_first >= target.row_last || box.y_last <= target.row_first) continue;
    const FaceSetup setup(a, b, c, box.x_first, box.y_first);
    const int32_t id = with_ids ? static_cast<int32_t>(f) : -1;
    if (box.x_last - box.x_first == 1 && box.y_last - box.y_first == 1) {
      const int64_t least = std::min(setup.area[0], std::min(setup.area[1], setup.area[2]));
      if (least < 0) continue;
      if (least == 0 && ((setup.area[0] + setup.Bias(0)) | (setup.area[1] + setup.Bias(1)) |
                         (setup.area[2] + setup.Bias(2))) < 0) {
        continue;
      }
      target.Draw(box.x_first, box.y_first, setup.Plane(a, b, c).At(setup.area[1], setup.area[2]), id);
      continue;
    }
    if (setup.total == 0) continue;
    DrawRows(setup, setup.Plane(a, b, c), box, id, target);
  }
  return count;
}

}  // namespace HWY_NAMESPACE
}  // namespace tessera
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace tessera {
HWY_EXPORT(Project);
HWY_EXPORT(Select);
HWY_EXPORT(Draw);

void ProjectToGrid(const Eigen::Vector3d* vertices, int64_t count, const PosedCamera& camera, double near_m,
                   GridVertex* out) {
  if (count > 0) HWY_DYNAMIC_DISPATCH(Project)(vertices, count, camera, near_m, out);
}

int64_t SelectFaces(const Triangle* faces, int64_t first, int64_t last, const GridVertex* vertices, int width,
                    int height, uint32_t* list) {
  return HWY_DYNAMIC_DISPATCH(Select)(faces, first, last, vertices, width, height, list);
}

int64_t DrawFaces(const Triangle* faces, const uint32_t* list, int64_t count, const GridVertex* vertices, bool with_ids,
                  const DrawTarget& target) {
  return HWY_DYNAMIC_DISPATCH(Draw)(faces, list, count, vertices, with_ids, target);
}

}  // namespace tessera
#endif  // HWY_ONCE
