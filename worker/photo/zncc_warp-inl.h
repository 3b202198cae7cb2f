// Part of zncc_kernel.cc, compiled once per instruction set: row buffers of the pipeline, and the warp with E_sem.
#if defined(TESSERA_WORKER_PHOTO_ZNCC_WARP_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef TESSERA_WORKER_PHOTO_ZNCC_WARP_INL_H_
#undef TESSERA_WORKER_PHOTO_ZNCC_WARP_INL_H_
#else
#define TESSERA_WORKER_PHOTO_ZNCC_WARP_INL_H_
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "worker/photo/zncc_kernel.h"

HWY_BEFORE_NAMESPACE();
namespace tessera {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Tag = hn::ScalableTag<float>;
using IntTag = hn::RebindToSigned<Tag>;
using BitsTag = hn::RebindToUnsigned<Tag>;
using Vec = hn::Vec<Tag>;
using Ints = hn::Vec<IntTag>;
using Bits = hn::Vec<BitsTag>;

// Rows advance by this many at a time and share their loads.
constexpr int kSlab = 4;

// Luminance is q·kScale + kShift of its code q: centred at zero, where float sums of squares lose least precision.
constexpr float kLuminanceScale = 1 / Texels::kLuminanceSteps;
constexpr float kLuminanceShift = -0.5f - kLuminanceScale;

// Rounds x - ½ to an integer when added, since floats of this size are integers. Requires |x| much smaller.
constexpr float kFloor = 12582912;
constexpr uint32_t kFloorBits = 0x4b400000;

// Row buffers of the pipeline for one strip: rings of window rows, each with one block of zeros on either side, and
// lines for the sums of one slab, which hold only the current columns.
class Rows {
 public:
  enum Plane { kMask, kRef, kOther, kSlope, kAlpha, kBeta, kGamma, kEta, kRingPlanes };
  // Content of a block of a row: a pixel seen by both views; one used in the reference but not seen; coefficients.
  enum Flag : uint8_t { kSeen = 1, kLost = 2, kScored = 4 };
  static constexpr int kLines = 6 * kSlab;
  static constexpr int kChunk = 8;  // blocks processed at a time

  Rows(int width, int radius, ZnccScratch* scratch) : ring_(kSlab + 2 * radius) {
    blocks_ = (width + kPixelBlock - 1) / kPixelBlock;
    stride_ = ((blocks_ + 2) | 1) * kPixelBlock;
    plane_ = static_cast<size_t>(stride_) * ring_;
    scratch->data.resize(plane_ * kRingPlanes + kLineStride * kLines);
    scratch->flags.assign(static_cast<size_t>(blocks_ + 2) * (2 * ring_ + 2), 0);
    for (int row = 0; row < ring_ * kRingPlanes; ++row) {
      float* begin = scratch->data.data() + static_cast<size_t>(stride_) * row;
      std::fill_n(begin, kPixelBlock, 0.0f);
      std::fill_n(begin + (blocks_ + 1) * kPixelBlock, kPixelBlock, 0.0f);
    }
    base_ = scratch->data.data() + kPixelBlock;
    lines_ = scratch->data.data() + plane_ * kRingPlanes;
    flags_ = scratch->flags.data() + 1;
  }
  int blocks() const { return blocks_; }
  size_t plane_size() const { return plane_; }
  float* Ring(Plane plane, int y) { return base_ + plane_ * plane + stride_ * static_cast<size_t>(Slot(y)); }
  // Indexed by column. Valid for the current chunk, two blocks before it and one after it.
  float* Line(int i) { return lines_ + kLineStride * i - line_begin_; }
  // Flags of a row of pixels (kSeen, kLost) and of a row of windows (kScored).
  uint8_t* PixelFlags(int y) { return flags_ + static_cast<size_t>(blocks_ + 2) * Slot(y); }
  uint8_t* WindowFlags(int y) { return flags_ + static_cast<size_t>(blocks_ + 2) * (ring_ + Slot(y)); }
  // Flags of the current slab: inputs of its column sums, and its results.
  uint8_t* SumState() { return flags_ + static_cast<size_t>(blocks_ + 2) * (2 * ring_); }
  uint8_t* State() { return flags_ + static_cast<size_t>(blocks_ + 2) * (2 * ring_ + 1); }

  // Processes the columns in chunks, so that the output of `first` is still in the L1 cache when `second`, one block
  // behind, reads it. Both take a range of blocks.
  template <class First, class Second>
  void InChunks(const First& first, const Second& second) {
    line_begin_ = -2 * kPixelBlock;
    ClearInLines(-1);
    for (int begin = 0, ready = 0; begin < blocks_; begin += kChunk) {
      const int end = std::min(blocks_, begin + kChunk);
      first(begin, end);
      if (end == blocks_) ClearInLines(end);
      const int available = end == blocks_ ? blocks_ : end - 1;
      second(ready, available);
      ready = available;
      for (int i = 0; i < kLines; ++i) {
        std::copy_n(Line(i) + (end - 2) * kPixelBlock, 2 * kPixelBlock, lines_ + kLineStride * i);
      }
      line_begin_ = (end - 2) * kPixelBlock;
    }
  }

  void ClearPixels(int y) {
    for (int p = kMask; p <= kSlope; ++p) std::fill_n(Ring(static_cast<Plane>(p), y), blocks_ * kPixelBlock, 0.0f);
    std::fill_n(PixelFlags(y), blocks_, uint8_t{0});
  }
  void ClearWindows(int y) {
    for (int p = kAlpha; p <= kEta; ++p) std::fill_n(Ring(static_cast<Plane>(p), y), blocks_ * kPixelBlock, 0.0f);
    std::fill_n(WindowFlags(y), blocks_, uint8_t{0});
  }

 private:
  static constexpr ptrdiff_t kLineStride = (kChunk + 3) * kPixelBlock;
  void ClearInLines(int block) {
    for (int i = 0; i < kLines; ++i) std::fill_n(Line(i) + block * kPixelBlock, kPixelBlock, 0.0f);
  }
  int Slot(int y) const { return ((y % ring_) + ring_) % ring_; }
  int ring_ = 0, blocks_ = 0, stride_ = 0;
  size_t plane_ = 0;
  ptrdiff_t line_begin_ = 0;
  float* base_ = nullptr;
  float* lines_ = nullptr;
  uint8_t* flags_ = nullptr;
};

// Sums along a row by position in the block, so that vectors of any length add in the same order.
struct LaneSums {
  alignas(64) float lane[kPixelBlock] = {};
  HWY_INLINE void Add(Tag d, int x, Vec value) {
    float* at = lane + (x & (kPixelBlock - 1));
    hn::Store(hn::Add(hn::Load(d, at), value), d, at);
  }
  double Total() const {
    double sum = 0;
    for (float value : lane) sum += static_cast<double>(value);
    return sum;
  }
};

HWY_INLINE Vec LoadLuminance(Tag d, const uint16_t* at) {
  const hn::Rebind<uint16_t, Tag> d16;
  return hn::ConvertTo(d, hn::PromoteTo(IntTag(), hn::LoadU(d16, at)));
}

// The texels at the left and right end of a bilinear cell's upper or lower edge.
struct EdgeTexels {
  Bits left, right;
};

// `offset`: in bytes from the plane's begin. One load of eight bytes fetches both texels.
HWY_INLINE EdgeTexels GatherEdge(const uint32_t* plane, Ints offset) {
  const BitsTag du;
#if HWY_TARGET == HWY_SCALAR
  const auto* base = reinterpret_cast<const int32_t*>(plane);
  return {hn::BitCast(du, hn::GatherOffset(IntTag(), base, offset)),
          hn::BitCast(du, hn::GatherOffset(IntTag(), base + 1, offset))};
#else
  const hn::Repartition<int64_t, Tag> d64;
  const hn::Rebind<int32_t, decltype(d64)> half;
  const auto* base = reinterpret_cast<const int64_t*>(plane);
  const auto low = hn::GatherOffset(d64, base, hn::PromoteTo(d64, hn::LowerHalf(half, offset)));
  const auto high = hn::GatherOffset(d64, base, hn::PromoteTo(d64, hn::UpperHalf(half, offset)));
  const Bits a = hn::BitCast(du, low), b = hn::BitCast(du, high);
  return {hn::ConcatEven(du, b, a), hn::ConcatOdd(du, b, a)};
#endif
}

template <int kByte>
HWY_INLINE Vec ByteOf(Tag d, Bits packed) {
  const Bits shifted = kByte == 0 ? packed : hn::ShiftRight<8 * kByte>(packed);
  const Bits byte = kByte == 3 ? shifted : hn::And(shifted, hn::Set(BitsTag(), 255u));
  return hn::ConvertTo(d, hn::BitCast(IntTag(), byte));
}

// Warped pixels: fractions in the bilinear cell, and motion in pixels per metre of the face's offset.
struct WarpedPosition {
  Vec a, b;
  Vec du, dv;
};

struct ClassSums {
  Vec squares, gradient, curvature;  // in steps of likelihood
};

template <int kByte>
HWY_INLINE void AddClass(Tag d, const EdgeTexels& top, const EdgeTexels& bottom, Bits reference,
                         const WarpedPosition& at, ClassSums& sums) {
  const Vec p00 = ByteOf<kByte>(d, top.left), p01 = ByteOf<kByte>(d, bottom.left);
  const Vec dx_top = hn::Sub(ByteOf<kByte>(d, top.right), p00);
  const Vec dx_bottom = hn::Sub(ByteOf<kByte>(d, bottom.right), p01);
  const Vec upper = hn::MulAdd(at.a, dx_top, p00), dv = hn::Sub(hn::MulAdd(at.a, dx_bottom, p01), upper);
  const Vec du = hn::MulAdd(at.b, hn::Sub(dx_bottom, dx_top), dx_top);
  const Vec difference = hn::Sub(hn::MulAdd(at.b, dv, upper), ByteOf<kByte>(d, reference));
  const Vec slope = hn::MulAdd(du, at.du, hn::Mul(dv, at.dv));
  sums.squares = hn::MulAdd(difference, difference, sums.squares);
  sums.gradient = hn::MulAdd(difference, slope, sums.gradient);
  sums.curvature = hn::MulAdd(slope, slope, sums.curvature);
}

// E_sem of the pixels at x of one row. `cell`: index of the cell's first texel in the other view's planes.
template <class Mask>
HWY_INLINE void AddSemantic(const ZnccPair& pair, float semantic_weight, int y, int x, Ints cell,
                            const WarpedPosition& at, Mask mask, float* gradient, float* curvature, LaneSums* energy) {
  const Tag d;
  const Texels& other = *pair.other->texels;
  const Ints top_offset = hn::ShiftLeft<2>(cell);
  const Ints bottom_offset = hn::Add(top_offset, hn::Set(IntTag(), 4 * other.stride));
  const size_t here = pair.reference->Index(x, y);
  ClassSums sums{hn::Zero(d), hn::Zero(d), hn::Zero(d)};
  for (size_t p = 0; p < other.likelihoods.size(); ++p) {
    const EdgeTexels top = GatherEdge(other.likelihoods[p].data(), top_offset);
    const EdgeTexels bottom = GatherEdge(other.likelihoods[p].data(), bottom_offset);
    const Bits reference = hn::LoadU(BitsTag(), pair.reference->likelihoods[p].data() + here);
    const int classes = other.classes - static_cast<int>(p) * Texels::kClassesPerPlane;
    AddClass<0>(d, top, bottom, reference, at, sums);
    if (classes > 1) AddClass<1>(d, top, bottom, reference, at, sums);
    if (classes > 2) AddClass<2>(d, top, bottom, reference, at, sums);
    if (classes > 3) AddClass<3>(d, top, bottom, reference, at, sums);
  }
  constexpr float kUnit = 1 / (Texels::kLikelihoodSteps * Texels::kLikelihoodSteps);
  energy->Add(d, x, hn::IfThenElseZero(mask, hn::Mul(sums.squares, hn::Set(d, 0.5f * kUnit))));
  const Vec factor = hn::IfThenElseZero(mask, hn::Set(d, semantic_weight * kUnit));
  const Vec g = hn::IfThenElseZero(mask, hn::Mul(sums.gradient, factor));
  const Vec h = hn::IfThenElseZero(mask, hn::Mul(sums.curvature, factor));
  hn::StoreU(hn::Add(hn::LoadU(d, gradient + x), g), d, gradient + x);
  hn::StoreU(hn::Add(hn::LoadU(d, curvature + x), h), d, curvature + x);
}

// Prefetch distance in texels of the other view: the offset between the warped positions of the middle of row y and
// of the same column some rows below. 0 if the middle pixel is not used.
inline int64_t TexelsAhead(const ZnccPair& pair, const ReferenceStrip& strip, int y) {
  constexpr float kRows = 6;
  const int x = pair.reference->width / 2;
  if (strip.depth_factor.row(y)[x] == 0) return 0;
  const float z = strip.depth.row(y)[x];
  const float xc = static_cast<float>(pair.reference->x0 + x) + 0.5f;
  const float yc = static_cast<float>(pair.reference->y0 + y) + 0.5f;
  float q[3], below[3];
  for (int r = 0; r < 3; ++r) {
    q[r] = z * (pair.m[3 * r] * xc + pair.m[3 * r + 1] * yc + pair.m[3 * r + 2]) + pair.t[r];
    below[r] = q[r] + z * kRows * pair.m[3 * r + 1];
  }
  const float du = below[0] / below[2] - q[0] / q[2], dv = below[1] / below[2] - q[1] / q[2];
  if (!(std::abs(du) < 64 && std::abs(dv) < 64)) return 0;
  return std::lround(dv) * pair.other->texels->stride + std::lround(du);
}

// Only a hint: the address may be outside the plane.
HWY_INLINE void Prefetch(const uint32_t* plane, int64_t index) {
  __builtin_prefetch(reinterpret_cast<const void*>(reinterpret_cast<uintptr_t>(plane) + 4 * index));
}

// Warps row y of the reference into the other image. Writes the mask, both luminances under it, and the slope
// dI_j/d(offset); with kSemantic also adds the row's E_sem, with energies summed by lane. Branch-free per vector:
// pixels outside the image are warped to its first pixel and masked, because a gather with valid addresses is cheaper
// than divergent code. Visibility is tested against the nearest pixel only, which is one of the four gathered texels.
template <bool kSemantic>
void WarpRow(const ZnccPair& pair, float semantic_weight, int y, Rows& rows, ReferenceStrip* strip, ZnccSums* totals) {
  const Tag d;
  const IntTag di;
  const BitsTag du;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const WarpTarget& target = *pair.other;
  const Texels& other = *target.texels;
  const float yc = static_cast<float>(pair.reference->y0 + y) + 0.5f;
  const Vec row0 = hn::Set(d, pair.m[1] * yc + pair.m[2]);
  const Vec row1 = hn::Set(d, pair.m[4] * yc + pair.m[5]);
  const Vec row2 = hn::Set(d, pair.m[7] * yc + pair.m[8]);
  const Vec m0x = hn::Set(d, pair.m[0]), m1x = hn::Set(d, pair.m[3]), m2x = hn::Set(d, pair.m[6]);
  const Vec t0 = hn::Set(d, pair.t[0]), t1 = hn::Set(d, pair.t[1]), t2 = hn::Set(d, pair.t[2]);
  const Vec half = hn::Set(d, 0.5f), one = hn::Set(d, 1.0f), zero = hn::Zero(d);
  const Vec u_min = hn::Set(d, static_cast<float>(other.x0) + 0.5f);
  const Vec v_min = hn::Set(d, static_cast<float>(other.y0) + 0.5f);
  const Vec u_max = hn::Set(d, static_cast<float>(other.x0 + other.width) - 0.5f);
  const Vec v_max = hn::Set(d, static_cast<float>(other.y0 + other.height) - 0.5f);
  const Vec slack = hn::Set(d, 1.0f + pair.depth_slack);
  const Vec scale = hn::Set(d, kLuminanceScale), shift = hn::Set(d, kLuminanceShift);
  const Vec depth_min = hn::Set(d, target.depth_min), depth_step = hn::Set(d, target.depth_step);
  const Vec floor = hn::Set(d, kFloor), nothing = hn::Set(d, static_cast<float>(WarpTarget::kNothing));
  const Ints stride = hn::Set(di, other.stride), stride_bytes = hn::Set(di, 4 * other.stride);
  // Constant part of a cell's index: the bits of kFloor and the position of the first pixel.
  const uint32_t rows_before = kFloorBits + static_cast<uint32_t>(other.y0);
  const Ints floor_cell = hn::Set(di, static_cast<int32_t>(rows_before * static_cast<uint32_t>(other.stride) +
                                                           kFloorBits + static_cast<uint32_t>(other.x0)));
  const int64_t ahead = TexelsAhead(pair, *strip, y);
  const Bits low_half = hn::Set(du, 0xffffu);
  const float* z_row = strip->depth.row(y);
  const float* factor_row = strip->depth_factor.row(y);
  const uint16_t* ref_row = pair.reference->luminance.data() + pair.reference->Index(0, y);
  float* out_mask = rows.Ring(Rows::kMask, y);
  float* out_ref = rows.Ring(Rows::kRef, y);
  float* out_other = rows.Ring(Rows::kOther, y);
  float* out_slope = rows.Ring(Rows::kSlope, y);
  float* gradient_row = kSemantic ? strip->gradient.row(y) : nullptr;
  float* curvature_row = kSemantic ? strip->curvature.row(y) : nullptr;
  float* count_row = kSemantic ? strip->count.row(y) : nullptr;
  uint8_t* flags = rows.PixelFlags(y);
  const Vec ramp = hn::Iota(d, 0.5f);
  LaneSums energy, pixels;
  for (int x = 0; x < rows.blocks() * kPixelBlock; x += lanes) {
    if (x % kPixelBlock == 0) flags[x / kPixelBlock] = 0;
    const Vec factor = hn::LoadU(d, factor_row + x);
    const auto used = hn::Ne(factor, zero);
    if (hn::AllFalse(d, used)) {
      hn::StoreU(zero, d, out_mask + x);
      hn::StoreU(zero, d, out_ref + x);
      hn::StoreU(zero, d, out_other + x);
      hn::StoreU(zero, d, out_slope + x);
      continue;
    }
    const Vec z = hn::LoadU(d, z_row + x);
    const Vec xc = hn::Add(ramp, hn::Set(d, static_cast<float>(pair.reference->x0 + x)));
    const Vec m0 = hn::MulAdd(m0x, xc, row0), m1 = hn::MulAdd(m1x, xc, row1), m2 = hn::MulAdd(m2x, xc, row2);
    const Vec q2 = hn::MulAdd(z, m2, t2);
    auto mask = hn::And(used, hn::Gt(q2, zero));
    const Vec inverse = hn::Div(one, q2);
    const Vec u = hn::Mul(hn::MulAdd(z, m0, t0), inverse), v = hn::Mul(hn::MulAdd(z, m1, t1), inverse);
    mask = hn::And(mask,
                   hn::And(hn::And(hn::Ge(u, u_min), hn::Lt(u, u_max)), hn::And(hn::Ge(v, v_min), hn::Lt(v, v_max))));
    const Vec us = hn::IfThenElse(mask, u, u_min), vs = hn::IfThenElse(mask, v, v_min);
    // The bilinear cell around (u, v); its corners are pixel centres.
    const Vec u_floor = hn::Add(hn::Sub(us, one), floor), v_floor = hn::Add(hn::Sub(vs, one), floor);
    WarpedPosition at;
    at.a = hn::Sub(hn::Sub(us, half), hn::Sub(u_floor, floor));
    at.b = hn::Sub(hn::Sub(vs, half), hn::Sub(v_floor, floor));
    const Ints cell = hn::Sub(hn::Add(hn::Mul(hn::BitCast(di, v_floor), stride), hn::BitCast(di, u_floor)), floor_cell);
    const Ints offset = hn::ShiftLeft<2>(cell);
    const int64_t later = hn::GetLane(cell) + ahead;
    Prefetch(target.packed.data(), later);
    if (kSemantic) Prefetch(other.likelihoods[0].data(), later);
    const EdgeTexels top = GatherEdge(target.packed.data(), offset);
    const EdgeTexels bottom = GatherEdge(target.packed.data(), hn::Add(offset, stride_bytes));
    const auto luminance = [&](Bits texel) { return hn::ConvertTo(d, hn::BitCast(di, hn::And(texel, low_half))); };
    const Vec p00 = luminance(top.left), p10 = luminance(top.right);
    const Vec p01 = luminance(bottom.left), p11 = luminance(bottom.right);
    // The pixel that contains (u, v) is one of the four.
    const auto lower = hn::RebindMask(du, hn::Ge(at.b, half)), right = hn::RebindMask(du, hn::Ge(at.a, half));
    const Bits nearest = hn::IfThenElse(right, hn::IfThenElse(lower, bottom.right, top.right),
                                        hn::IfThenElse(lower, bottom.left, top.left));
    const Vec code = hn::ConvertTo(d, hn::BitCast(di, hn::ShiftRight<16>(nearest)));
    const auto unhidden =
        hn::Or(hn::Le(q2, hn::Mul(hn::MulAdd(code, depth_step, depth_min), slack)), hn::Eq(code, nothing));
    const Vec dx_top = hn::Sub(p10, p00), dx_bottom = hn::Sub(p11, p01);
    const Vec i_top = hn::MulAdd(at.a, dx_top, p00), i_bottom = hn::MulAdd(at.a, dx_bottom, p01);
    const Vec dv = hn::Sub(i_bottom, i_top);
    const Vec value = hn::MulAdd(hn::MulAdd(at.b, dv, i_top), scale, shift);
    const Vec du_raw = hn::MulAdd(at.b, hn::Sub(dx_bottom, dx_top), dx_top);
    const auto valid = hn::Gt(hn::Min(hn::Min(p00, p10), hn::Min(p01, p11)), zero);
    mask = hn::And(mask, hn::And(valid, unhidden));
    // d(u, v)/dz along the ray, converted to per metre of the face's offset.
    const Vec chain = hn::Mul(inverse, factor);
    at.du = hn::Mul(hn::NegMulAdd(u, m2, m0), chain);
    at.dv = hn::Mul(hn::NegMulAdd(v, m2, m1), chain);
    const Vec slope = hn::Mul(hn::MulAdd(du_raw, at.du, hn::Mul(dv, at.dv)), scale);
    const Vec ref = hn::MulAdd(LoadLuminance(d, ref_row + x), scale, shift);
    hn::StoreU(hn::IfThenElseZero(mask, one), d, out_mask + x);
    hn::StoreU(hn::IfThenElseZero(mask, ref), d, out_ref + x);
    hn::StoreU(hn::IfThenElseZero(mask, value), d, out_other + x);
    hn::StoreU(hn::IfThenElseZero(mask, slope), d, out_slope + x);
    const bool seen = !hn::AllFalse(d, mask), lost = !hn::AllFalse(d, hn::AndNot(mask, used));
    flags[x / kPixelBlock] |= static_cast<uint8_t>((seen ? Rows::kSeen : 0) | (lost ? Rows::kLost : 0));
    if (kSemantic && seen) {
      AddSemantic(pair, semantic_weight, y, x, cell, at, mask, gradient_row, curvature_row, &energy);
      const Vec ones = hn::IfThenElseZero(mask, one);
      pixels.Add(d, x, ones);
      hn::StoreU(hn::Add(hn::LoadU(d, count_row + x), ones), d, count_row + x);
    }
  }
  if (kSemantic) {
    totals->semantic_energy += energy.Total();
    totals->semantic_pixels += static_cast<int64_t>(pixels.Total());
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace tessera
HWY_AFTER_NAMESPACE();

#endif  // TESSERA_WORKER_PHOTO_ZNCC_WARP_INL_H_
