#include "worker/visibility/raster_kernel.h"

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
constexpr int32_t kToCentre = static_cast<int32_t>(kGridHalf - 1);  // to the next centre at or after, before a shift
constexpr int kExtentBits = 25;     // limit of face sizes drawn here, so that areas stay below 2^53
constexpr int kNarrowColumns = 16;  // longer rows pay for one division per edge

// A camera matrix and the transform from its image to the grid.
struct Projection {
  double row[3][4];
  double x_scale, x_shift, y_scale, y_shift, near_m;
  int32_t x_first, y_first;  // grid units of the window's first pixel
};

// Images of a vector of vertices, in grid units of the whole image; all 0 where not `good`.
struct ImageLanes {
  hn::Vec<Doubles> u, v, inverse_z;
  hn::Mask<Doubles> good;
};

HWY_INLINE ImageLanes ProjectLanes(const Projection& p, const double* in) {
  const Doubles d;
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
  const auto good =
      hn::And(hn::Ge(depth, hn::Set(d, p.near_m)), hn::And(hn::Lt(hn::Abs(u), limit), hn::Lt(hn::Abs(v), limit)));
  return {hn::IfThenElseZero(good, u), hn::IfThenElseZero(good, v), hn::IfThenElseZero(good, inverse), good};
}

HWY_INLINE void StoreLanes(const Projection& p, const ImageLanes& image, GridVertex* out) {
  const Doubles d;
  const Ints di;
  const auto to_grid = [&](auto value, int32_t first) HWY_ATTR {
    const auto whole = hn::DemoteTo(di, hn::Round(value));
    return hn::Sub(whole, hn::DemoteTo(di, hn::IfThenElseZero(image.good, hn::Set(d, static_cast<double>(first)))));
  };
  const auto flag = hn::DemoteTo(di, hn::IfThenZeroElse(image.good, hn::Set(d, -1.0)));
  const auto inverse_z = hn::BitCast(di, hn::DemoteTo(Floats(), image.inverse_z));
  hn::StoreInterleaved4(to_grid(image.u, p.x_first), to_grid(image.v, p.y_first), inverse_z, flag, di,
                        reinterpret_cast<int32_t*>(out));
}

HWY_INLINE void StoreLanes(const Projection&, const ImageLanes& image, ImageVertex* out) {
  const Doubles d;
  const auto pixels = hn::Set(d, 1.0 / kGridPerPixel);
  hn::StoreInterleaved3(hn::Mul(image.u, pixels), hn::Mul(image.v, pixels), image.inverse_z, d,
                        reinterpret_cast<double*>(out));
}

template <class Vertex>
HWY_INLINE void ProjectAll(const Eigen::Vector3d* vertices, int64_t count, const CameraWindow& window, double near_m,
                           Vertex* out) {
  const PosedCamera& camera = window.camera;
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
  p.x_first = window.rect.x0 << kGridBits;
  p.y_first = window.rect.y0 << kGridBits;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(Doubles()));
  const double* in = vertices->data();
  int64_t v = 0;
  for (; v + lanes <= count; v += lanes) StoreLanes(p, ProjectLanes(p, in + 3 * v), out + v);
  if (v < count) {
    double tail[12] = {};
    Vertex tail_out[4];
    std::copy(in + 3 * v, in + 3 * count, tail);
    StoreLanes(p, ProjectLanes(p, tail), tail_out);
    std::copy_n(tail_out, count - v, out + v);
  }
}

void Project(const Eigen::Vector3d* vertices, int64_t count, const CameraWindow& window, double near_m,
             GridVertex* out) {
  ProjectAll(vertices, count, window, near_m, out);
}

void ProjectUnrounded(const Eigen::Vector3d* vertices, int64_t count, const CameraWindow& window, double near_m,
                      ImageVertex* out) {
  ProjectAll(vertices, count, window, near_m, out);
}

// Whether a face's bounding box contains a pixel centre, or it has a vertex off the grid.
#if HWY_TARGET == HWY_SCALAR
class FaceSelector {
 public:
  FaceSelector(int width, int height) : width_(width), height_(height) {}
  bool Takes(const GridVertex& a, const GridVertex& b, const GridVertex& c) const {
    return (a.off_grid | b.off_grid | c.off_grid) != 0 ||
           (HoldsCentre(a.x, b.x, c.x, width_) && HoldsCentre(a.y, b.y, c.y, height_));
  }

 private:
  static bool HoldsCentre(int32_t a, int32_t b, int32_t c, int32_t limit) {
    const int32_t first = std::min(a, std::min(b, c)) + kToCentre, last = std::max(a, std::max(b, c)) + kToCentre;
    return std::max(first >> kGridBits, 0) < std::min(last >> kGridBits, limit);
  }
  int width_, height_;
};
#else
// Loads the four fields of a GridVertex as one vector.
class FaceSelector {
  using Quad = hn::FixedTag<int32_t, 4>;
  using Vec = hn::Vec<Quad>;

 public:
  HWY_INLINE FaceSelector(int width, int height) {
    alignas(16) const int32_t size[4] = {width, height, 0, 0}, others[4] = {0, 0, -1, -1};
    size_ = hn::Load(Quad(), size);
    others_ = hn::Load(Quad(), others);
    to_centre_ = hn::Set(Quad(), kToCentre);
  }
  HWY_INLINE bool Takes(const GridVertex& a, const GridVertex& b, const GridVertex& c) const {
    const Vec va = LoadVertex(a), vb = LoadVertex(b), vc = LoadVertex(c);
    const Vec low = hn::Min(hn::Min(va, vb), vc), high = hn::Max(hn::Max(va, vb), vc);
    const Vec first = hn::Max(hn::ShiftRight<kGridBits>(hn::Add(low, to_centre_)), hn::Zero(Quad()));
    const Vec last = hn::Min(hn::ShiftRight<kGridBits>(hn::Add(high, to_centre_)), size_);
    const Vec covers = hn::Or(hn::VecFromMask(Quad(), hn::Gt(last, first)), others_);
    return hn::AllTrue(Quad(), hn::MaskFromVec(hn::Or(covers, hn::Broadcast<3>(low))));
  }

 private:
  static HWY_INLINE Vec LoadVertex(const GridVertex& vertex) {
    return hn::Load(Quad(), reinterpret_cast<const int32_t*>(&vertex));
  }
  Vec size_, others_, to_centre_;
};
#endif

int64_t Select(const Triangle* faces, int64_t first, int64_t last, const GridVertex* vertices, int width, int height,
               uint32_t* list) {
  const FaceSelector selector(width, height);
  int64_t count = 0;
  for (int64_t f = first; f < last; ++f) {
    const Triangle& face = faces[f];
    list[count] = static_cast<uint32_t>(f);
    // Branch-free: whether a face contains a centre is unpredictable.
    count += selector.Takes(vertices[face[0]], vertices[face[1]], vertices[face[2]]);
  }
  return count;
}

// Faces to be drawn, one per column. Areas are twice those that an edge spans with a pixel's centre, positive inside.
// They are integers below 2^53 and therefore exact in double.
struct FaceBatch {
  static constexpr int kFaces = 64;
  enum Field {
    kArea0,
    kArea1,
    kArea2,  // for edges bc, ca, ab at the centre of the box's first pixel
    kPerColumn0,
    kPerColumn1,
    kPerColumn2,
    kPerRow0,
    kPerRow1,
    kPerRow2,
    kLeast0,
    kLeast1,
    kLeast2,  // smallest area inside: 0 if the face owns the edge, else 1
    kAtA,
    kForB,
    kForC,
    kLow,
    kHigh,  // DepthPlane
    kFields
  };
  alignas(32) double field[kFields][kFaces];
  alignas(16) int32_t x_first[kFaces], x_last[kFaces], y_first[kFaces], y_last[kFaces];
  alignas(16) float value[kFaces];  // 1/z at the first pixel's centre; 0: outside
};

// Fills columns [at, at + lanes) of the batch with listed faces. Returns how many of them, counted from the first,
// fit the grid.
HWY_INLINE int SetUpLanes(const Triangle* faces, const uint32_t* list, int64_t count, const GridVertex* vertices,
                          const DrawTarget& target, int at, FaceBatch* batch) {
  const Doubles d;
  const Ints di;
  constexpr int kMaxLanes = 4;
  const int lanes = static_cast<int>(hn::Lanes(d));
  alignas(16) GridVertex corners[3][kMaxLanes];
  for (int lane = 0; lane < lanes; ++lane) {
    const Triangle& face = faces[list[std::min<int64_t>(lane, count - 1)]];
    for (int c = 0; c < 3; ++c) corners[c][lane] = vertices[face[c]];
  }
  hn::Vec<Ints> x[3], y[3], iz[3], off_grid[3];
  for (int c = 0; c < 3; ++c) {
    hn::LoadInterleaved4(di, reinterpret_cast<const int32_t*>(corners[c]), x[c], y[c], iz[c], off_grid[c]);
  }
  const auto to_centre = hn::Set(di, kToCentre), half = hn::Set(di, static_cast<int32_t>(kGridHalf));
  const auto x_low = hn::Min(hn::Min(x[0], x[1]), x[2]), x_high = hn::Max(hn::Max(x[0], x[1]), x[2]);
  const auto y_low = hn::Min(hn::Min(y[0], y[1]), y[2]), y_high = hn::Max(hn::Max(y[0], y[1]), y[2]);
  const auto x_first = hn::Max(hn::ShiftRight<kGridBits>(hn::Add(x_low, to_centre)), hn::Zero(di));
  const auto y_first = hn::Max(hn::ShiftRight<kGridBits>(hn::Add(y_low, to_centre)), hn::Zero(di));
  const auto x_last = hn::Min(hn::ShiftRight<kGridBits>(hn::Add(x_high, to_centre)), hn::Set(di, target.width));
  const auto y_last = hn::Min(hn::ShiftRight<kGridBits>(hn::Add(y_high, to_centre)), hn::Set(di, target.height));
  hn::Store(x_first, di, batch->x_first + at);
  hn::Store(y_first, di, batch->y_first + at);
  hn::Store(x_last, di, batch->x_last + at);
  hn::Store(y_last, di, batch->y_last + at);

  // Corners relative to the first pixel's centre.
  const auto x0 = hn::Add(hn::ShiftLeft<kGridBits>(x_first), half);
  const auto y0 = hn::Add(hn::ShiftLeft<kGridBits>(y_first), half);
  hn::Vec<Doubles> px[3], py[3], area[3], per_column[3], per_row[3], least[3];
  for (int c = 0; c < 3; ++c) {
    px[c] = hn::PromoteTo(d, hn::Sub(x[c], x0));
    py[c] = hn::PromoteTo(d, hn::Sub(y[c], y0));
  }
  for (int i = 0; i < 3; ++i) {
    const int p = (i + 1) % 3, q = (i + 2) % 3;
    area[i] = hn::Sub(hn::Mul(px[p], py[q]), hn::Mul(py[p], px[q]));
    per_column[i] = hn::Sub(py[p], py[q]);
    per_row[i] = hn::Sub(px[q], px[p]);
  }
  auto total = hn::Add(hn::Add(area[0], area[1]), area[2]);
  const auto zero = hn::Zero(d), one = hn::Set(d, 1.0), pixel = hn::Set(d, static_cast<double>(kGridPerPixel));
  const auto clockwise = hn::And(total, hn::Set(d, -0.0));
  total = hn::Abs(total);
  auto inside = hn::Gt(total, zero);
  for (int i = 0; i < 3; ++i) {
    area[i] = hn::Xor(area[i], clockwise);
    per_column[i] = hn::Xor(per_column[i], clockwise);
    per_row[i] = hn::Xor(per_row[i], clockwise);
    // A centre on an edge belongs to the face to the right; on a horizontal edge to the face below (top-left rule).
    const auto level = hn::And(hn::Eq(per_column[i], zero), hn::Gt(per_row[i], zero));
    least[i] = hn::IfThenElse(hn::Or(hn::Gt(per_column[i], zero), level), zero, one);
    inside = hn::And(inside, hn::Ge(area[i], least[i]));
    hn::Store(area[i], d, batch->field[FaceBatch::kArea0 + i] + at);
    hn::Store(hn::Mul(per_column[i], pixel), d, batch->field[FaceBatch::kPerColumn0 + i] + at);
    hn::Store(hn::Mul(per_row[i], pixel), d, batch->field[FaceBatch::kPerRow0 + i] + at);
    hn::Store(least[i], d, batch->field[FaceBatch::kLeast0 + i] + at);
  }
  const Floats df;
  hn::Vec<Doubles> z[3];
  for (int c = 0; c < 3; ++c) z[c] = hn::PromoteTo(d, hn::BitCast(df, iz[c]));
  const auto for_b = hn::Div(hn::Sub(z[1], z[0]), total), for_c = hn::Div(hn::Sub(z[2], z[0]), total);
  const auto low = hn::Min(hn::Min(z[0], z[1]), z[2]), high = hn::Max(hn::Max(z[0], z[1]), z[2]);
  hn::Store(z[0], d, batch->field[FaceBatch::kAtA] + at);
  hn::Store(for_b, d, batch->field[FaceBatch::kForB] + at);
  hn::Store(for_c, d, batch->field[FaceBatch::kForC] + at);
  hn::Store(low, d, batch->field[FaceBatch::kLow] + at);
  hn::Store(high, d, batch->field[FaceBatch::kHigh] + at);
  auto value = hn::Add(z[0], hn::Add(hn::Mul(area[1], for_b), hn::Mul(area[2], for_c)));
  value = hn::IfThenElseZero(inside, hn::Min(hn::Max(value, low), high));
  hn::Store(hn::DemoteTo(df, value), df, batch->value + at);

  // Extents beyond 31 bits wrap to negative numbers.
  const auto extent = hn::Or(hn::Sub(x_high, x_low), hn::Sub(y_high, y_low));
  const auto off = hn::Or(hn::Or(off_grid[0], off_grid[1]), hn::Or(off_grid[2], hn::ShiftRight<kExtentBits>(extent)));
  const int fitting = static_cast<int>(std::min<int64_t>(lanes, count));
  if (hn::AllTrue(di, hn::Eq(off, hn::Zero(di)))) return fitting;
  alignas(16) int32_t is_off[kMaxLanes];
  hn::Store(off, di, is_off);
  for (int lane = 0; lane < fitting; ++lane) {
    if (is_off[lane] != 0) return lane;
  }
  return fitting;
}

// Shrinks columns [first, last) of a row to approximately those inside the edges.
HWY_INLINE void NarrowRow(const double* area, const double* per_column, int* first, int* last) {
  int begin = *first, end = *last;
  for (int i = 0; i < 3; ++i) {
    const double crossing =
        -area[i] / per_column[i];  // columns after *first; NaN and infinity fail the comparisons below
    if (per_column[i] > 0 && crossing > 1 && crossing < 1e6) {
      begin = std::max(begin, *first + static_cast<int>(crossing) - 1);
    }
    if (per_column[i] < 0 && crossing < 1e6) {
      end = std::min(end, *first + (crossing > 0 ? static_cast<int>(crossing) : 0) + 2);
    }
  }
  *first = begin;
  *last = end;
}

// The map is read and written in windows of one vector, starting at a face's first column. Aligned windows would be
// more numerous and measured slower. The last window of a row is shifted left to end with the row.
HWY_INLINE int WindowInRow(int window, int lanes, const DrawTarget& target) {
  return std::min(window, target.width - lanes);
}

// Draws the pixels of the window, from pixel i on, whose 1/z is greater than the stored one.
HWY_INLINE void DrawWindow(hn::Vec<Floats> value, hn::Vec<Ints> ids, size_t i, const DrawTarget& target) {
  const Floats df;
  const Ints di;
  const auto old = hn::LoadU(df, target.inverse_z + i);
  const auto old_ids = hn::LoadU(di, target.face + i);
  const auto nearer = hn::Gt(value, old);
  hn::StoreU(hn::IfThenElse(nearer, value, old), df, target.inverse_z + i);
  hn::StoreU(hn::IfThenElse(hn::RebindMask(di, nearer), ids, old_ids), di, target.face + i);
}

// Draws the only pixel of the bounding box of the batch's face k.
HWY_INLINE void DrawPixelFromBatch(const FaceBatch& batch, int k, int32_t id, const DrawTarget& target) {
  const Floats df;
  const Ints di;
  const int lanes = static_cast<int>(hn::Lanes(df));
  const int x = WindowInRow(batch.x_first[k] & -lanes, lanes, target);
  const auto here = hn::Eq(hn::Iota(di, 0), hn::Set(di, batch.x_first[k] - x));
  const auto value = hn::IfThenElseZero(hn::RebindMask(df, here), hn::Set(df, batch.value[k]));
  DrawWindow(value, hn::Set(di, id), static_cast<size_t>(batch.y_first[k]) * target.width + x, target);
}

// Draws one face of the batch, one vector of pixels of a row at a time.
HWY_INLINE void DrawFromBatch(const FaceBatch& batch, int k, int32_t id, const DrawTarget& target) {
  const Doubles d;
  const Floats df;
  const Ints di;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto get = [&](int field) HWY_ATTR { return hn::Set(d, batch.field[field][k]); };
  const auto column0 = get(FaceBatch::kPerColumn0), column1 = get(FaceBatch::kPerColumn1),
             column2 = get(FaceBatch::kPerColumn2);
  const auto row0 = get(FaceBatch::kPerRow0), row1 = get(FaceBatch::kPerRow1), row2 = get(FaceBatch::kPerRow2);
  const auto least0 = get(FaceBatch::kLeast0), least1 = get(FaceBatch::kLeast1), least2 = get(FaceBatch::kLeast2);
  const auto at_a = get(FaceBatch::kAtA), for_b = get(FaceBatch::kForB), for_c = get(FaceBatch::kForC);
  const auto low = get(FaceBatch::kLow), high = get(FaceBatch::kHigh);
  const auto ids = hn::Set(di, id);
  const int x_begin = batch.x_first[k], y_begin = std::max(batch.y_first[k], target.row_first);
  const int y_end = std::min(batch.y_last[k], target.row_last);
  const auto down = hn::Set(d, static_cast<double>(y_begin - batch.y_first[k]));
  auto at0 = hn::MulAdd(row0, down, get(FaceBatch::kArea0)), at1 = hn::MulAdd(row1, down, get(FaceBatch::kArea1)),
       at2 = hn::MulAdd(row2, down, get(FaceBatch::kArea2));

  // All sums and products of areas are exact integers, in any order and with or without fused operations.
  const auto draw = [&](int first, int last, int y_from, int y_to) HWY_ATTR {
    for (int window = first; window < last; window += lanes) {
      const int x = WindowInRow(window, lanes, target);  // pixels outside the box are outside the face
      const auto right = hn::Add(hn::Iota(d, 0), hn::Set(d, static_cast<double>(x - x_begin)));
      auto e0 = hn::MulAdd(column0, right, at0), e1 = hn::MulAdd(column1, right, at1),
           e2 = hn::MulAdd(column2, right, at2);
      size_t i = static_cast<size_t>(y_from) * target.width + x;
      for (int y = y_from; y < y_to; ++y) {
        const auto inside = hn::And(hn::Ge(e0, least0), hn::And(hn::Ge(e1, least1), hn::Ge(e2, least2)));
        const auto plane = hn::Add(at_a, hn::Add(hn::Mul(e1, for_b), hn::Mul(e2, for_c)));
        const auto value = hn::DemoteTo(df, hn::IfThenElseZero(inside, hn::Min(hn::Max(plane, low), high)));
        DrawWindow(value, ids, i, target);
        e0 = hn::Add(e0, row0);
        e1 = hn::Add(e1, row1);
        e2 = hn::Add(e2, row2);
        i += static_cast<size_t>(target.width);
      }
    }
  };
  if (batch.x_last[k] - x_begin <= kNarrowColumns) {
    draw(x_begin, batch.x_last[k], y_begin, y_end);
    return;
  }
  const double per_column[3] = {hn::GetLane(column0), hn::GetLane(column1), hn::GetLane(column2)};
  for (int y = y_begin; y < y_end; ++y) {
    const double area[3] = {hn::GetLane(at0), hn::GetLane(at1), hn::GetLane(at2)};
    int first = x_begin, last = batch.x_last[k];
    NarrowRow(area, per_column, &first, &last);
    draw(first, last, y, y + 1);
    at0 = hn::Add(at0, row0);
    at1 = hn::Add(at1, row1);
    at2 = hn::Add(at2, row2);
  }
}

int64_t Draw(const Triangle* faces, const uint32_t* list, int64_t count, const GridVertex* vertices,
             const DrawTarget& target) {
  const int lanes = static_cast<int>(hn::Lanes(Doubles()));
  if (target.width < lanes) return 0;
  FaceBatch batch;
  for (int64_t done = 0; done < count;) {
    const int batch_size = static_cast<int>(std::min<int64_t>(FaceBatch::kFaces, count - done));
    int ready = 0;
    while (ready < batch_size) {
      const int expected = std::min(lanes, batch_size - ready);
      const int fitting = SetUpLanes(faces, list + done + ready, batch_size - ready, vertices, target, ready, &batch);
      ready += fitting;
      if (fitting < expected) break;
    }
    for (int k = 0; k < ready; ++k) {
      const int32_t id = target.selection.NameOf(list[done + k]);
      if (batch.x_last[k] - batch.x_first[k] == 1 && batch.y_last[k] - batch.y_first[k] == 1) {
        if (batch.y_first[k] >= target.row_first && batch.y_first[k] < target.row_last) {
          DrawPixelFromBatch(batch, k, id, target);
        }
      } else {
        DrawFromBatch(batch, k, id, target);
      }
    }
    done += ready;
    if (ready < batch_size) return done;
  }
  return count;
}

}  // namespace HWY_NAMESPACE
}  // namespace tessera
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace tessera {
HWY_EXPORT(Project);
HWY_EXPORT(ProjectUnrounded);
HWY_EXPORT(Select);
HWY_EXPORT(Draw);

void ProjectToGrid(const Eigen::Vector3d* vertices, int64_t count, const CameraWindow& window, double near_m,
                   GridVertex* out) {
  if (count > 0) HWY_DYNAMIC_DISPATCH(Project)(vertices, count, window, near_m, out);
}

void ProjectToImage(const Eigen::Vector3d* vertices, int64_t count, const PosedCamera& camera, double near_m,
                    ImageVertex* out) {
  if (count > 0) HWY_DYNAMIC_DISPATCH(ProjectUnrounded)(vertices, count, {camera, {}}, near_m, out);
}

int64_t SelectFaces(const Triangle* faces, int64_t first, int64_t last, const GridVertex* vertices, int width,
                    int height, uint32_t* list) {
  return HWY_DYNAMIC_DISPATCH(Select)(faces, first, last, vertices, width, height, list);
}

int64_t DrawFaces(const Triangle* faces, const uint32_t* list, int64_t count, const GridVertex* vertices,
                  const DrawTarget& target) {
  return HWY_DYNAMIC_DISPATCH(Draw)(faces, list, count, vertices, target);
}

}  // namespace tessera
#endif  // HWY_ONCE
