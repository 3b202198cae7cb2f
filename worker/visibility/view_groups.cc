#include "worker/visibility/view_groups.h"

#include <algorithm>
#include <bit>
#include <span>

#include "common/base/parallel.h"
#include "worker/visibility/bit_raster.h"

namespace tessera {
namespace {

constexpr int64_t kRowGrain = 64;
constexpr int kRun_px = 16;  // pixels that are tested together

}  // namespace

std::vector<uint8_t> ViewGroups::SelectedIn(size_t view) const {
  std::vector<uint8_t> out(group_of_face.empty() ? 0 : selected.size());
  for (size_t g = 0; g < out.size(); ++g) out[g] = selected[g][view];
  if (std::find(out.begin(), out.end(), 0) == out.end()) out.clear();
  return out;
}

FaceBits::FaceBits(const std::vector<uint8_t>& flags) : words_((flags.size() + 63) / 64), before_(words_.size()) {
  for (size_t f = 0; f < flags.size(); ++f) words_[f / 64] |= static_cast<uint64_t>(flags[f] != 0) << (f % 64);
  for (size_t w = 1; w < words_.size(); ++w) {
    before_[w] = before_[w - 1] + static_cast<uint32_t>(std::popcount(words_[w - 1]));
  }
}

FaceBits::Share FaceBits::Of(int32_t first, int32_t last) const {
  const int32_t begin = first >> 6, end = last >> 6;
  const uint64_t from_first = ~uint64_t{0} << (first & 63), to_last = ~uint64_t{0} >> (63 - (last & 63));
  bool any = false, missing = false;
  const auto add = [&](int32_t word, uint64_t mask) {
    any |= (words_[word] & mask) != 0;
    missing |= (~words_[word] & mask) != 0;
  };
  if (begin == end) {
    add(begin, from_first & to_last);
  } else {
    add(begin, from_first);
    add(end, to_last);
    const uint32_t between = before_[end] - before_[begin + 1];
    any |= between != 0;
    missing |= between != static_cast<uint32_t>(end - begin - 1) * 64;
  }
  return !any ? Share::kNone : missing ? Share::kSome : Share::kAll;
}

namespace {

// Sets the bits of the columns that show a face with a flag in `own`.
void MarkOwn(const FaceBits& own, std::span<const int32_t> face, std::span<uint64_t> row) {
  const auto width = static_cast<int>(face.size());
  for (int x = 0; x < width; x += kRun_px) {
    const int end = std::min(width, x + kRun_px);
    // No face is a large number without sign.
    auto low = static_cast<uint32_t>(face[x]), any = low;
    int32_t high = face[x];
    for (int k = x + 1; k < end; ++k) {
      low = std::min(low, static_cast<uint32_t>(face[k]));
      any |= static_cast<uint32_t>(face[k]);
      high = std::max(high, face[k]);
    }
    if (high < 0) continue;
    // Faces of a run are mostly of one cell, with ids near each other and equal flags.
    const FaceBits::Share share = own.Of(static_cast<int32_t>(low), high);
    if (share == FaceBits::Share::kNone) continue;
    uint64_t bits = 0;
    if (share == FaceBits::Share::kAll && static_cast<int32_t>(any) >= 0) {
      bits = (uint64_t{1} << (end - x)) - 1;
    } else {
      for (int k = x; k < end; ++k) {
        const bool is_own = face[k] >= 0 && own[face[k]];
        bits |= static_cast<uint64_t>(is_own) << (k - x);
      }
    }
    row[x / BitRaster::kWordBits] |= bits << (x % BitRaster::kWordBits);
  }
}

}  // namespace

void KeepNearOwn(const FaceBits& own, int margin_px, FaceMap* map) {
  // A separable dilation of the own pixels: along rows first, then along columns.
  const int width = map->width, height = map->height;
  BitRaster wide(width, height);
  ParallelForEach(height, kRowGrain, [&](int y) {
    const std::span<uint64_t> row = wide.row(y);
    MarkOwn(own, std::span(map->face).subspan(static_cast<size_t>(y) * width, width), row);
    Widen(row, margin_px);
  });
  ParallelForEach(height, kRowGrain, [&](int y) {
    int32_t* const face = map->face.data() + static_cast<size_t>(y) * width;
    const int above = std::max(0, y - margin_px), below = std::min(height - 1, y + margin_px);
    for (int x = 0; x < width; x += BitRaster::kWordBits) {
      uint64_t near = 0;
      for (int z = above; z <= below; ++z) near |= wide.row(z)[x / BitRaster::kWordBits];
      if (near == ~uint64_t{0}) continue;
      for (int k = x; k < std::min(width, x + BitRaster::kWordBits); ++k) {
        face[k] = near >> (k - x) & 1 ? face[k] : -1;
      }
    }
  });
}

}  // namespace tessera
