#include "worker/visibility/view_groups.h"

#include <algorithm>
#include <cassert>
#include <cstring>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kRowGrain = 64;
constexpr int kRun_px = 16;        // pixels that are tested together
constexpr int32_t kMostWords = 8;  // that a range of faces is compared with

}  // namespace

std::vector<uint8_t> ViewGroups::SelectedIn(size_t view) const {
  std::vector<uint8_t> out(group_of_face.empty() ? 0 : selected.size());
  for (size_t g = 0; g < out.size(); ++g) out[g] = selected[g][view];
  if (std::find(out.begin(), out.end(), 0) == out.end()) out.clear();
  return out;
}

FaceBits::FaceBits(const std::vector<uint8_t>& flags) : words_((flags.size() + 63) / 64) {
  for (size_t f = 0; f < flags.size(); ++f) words_[f / 64] |= static_cast<uint64_t>(flags[f] != 0) << (f % 64);
}

FaceBits::Share FaceBits::Of(int32_t first, int32_t last) const {
  const int32_t begin = first >> 6, end = last >> 6;
  if (end - begin >= kMostWords) return Share::kSome;
  uint64_t any = 0, missing = 0;
  for (int32_t w = begin; w <= end; ++w) {
    uint64_t mask = ~uint64_t{0};
    if (w == begin) mask &= ~uint64_t{0} << (first & 63);
    if (w == end) mask &= ~uint64_t{0} >> (63 - (last & 63));
    any |= words_[w] & mask;
    missing |= ~words_[w] & mask;
  }
  return any == 0 ? Share::kNone : missing == 0 ? Share::kAll : Share::kSome;
}

void KeepNearOwn(const FaceBits& own, int margin_px, FaceMap* map) {
  // A separable dilation of the own pixels: along rows first, then along columns.
  assert(margin_px < 128);
  const int width = map->width, height = map->height;
  std::vector<uint8_t> wide(map->face.size(), 0), has(height, 0);  // pixels, rows with any
  ParallelForEach(height, kRowGrain, [&](int64_t y) {
    const int32_t* face = map->face.data() + y * width;
    uint8_t* row = wide.data() + y * width;
    int marked = 0;  // columns before it are final
    const auto mark = [&](int begin, int end) {
      const int first = std::max(marked, begin - margin_px), last = std::min(width, end + margin_px);
      std::fill(row + first, row + last, 1);
      marked = last;
      has[y] = 1;
    };
    for (int x = 0; x < width; x += kRun_px) {
      const int end = std::min(width, x + kRun_px);
      int32_t low = face[x], high = face[x];
      for (int k = x + 1; k < end; ++k) {
        low = std::min(low, face[k]);
        high = std::max(high, face[k]);
      }
      if (high < 0) continue;
      // Faces of a run are mostly of one cell, with ids near each other and equal flags.
      const FaceBits::Share share = low < 0 ? FaceBits::Share::kSome : own.Of(low, high);
      if (share == FaceBits::Share::kNone) continue;
      if (share == FaceBits::Share::kAll) {
        mark(x, end);
        continue;
      }
      for (int k = x; k < end; ++k) {
        if (face[k] >= 0 && own[face[k]]) mark(k, k + 1);
      }
    }
  });
  ParallelFor(height, kRowGrain, [&](int64_t begin, int64_t end) {
    std::vector<uint8_t> near(width, 0);  // per column: number of set pixels in the rows within the margin
    const auto add = [&](int64_t z, uint8_t sign) {
      if (z < 0 || z >= height || !has[z]) return;
      const uint8_t* row = wide.data() + z * width;
      for (int x = 0; x < width; ++x) near[x] = static_cast<uint8_t>(near[x] + sign * row[x]);
    };
    for (int64_t z = begin - margin_px; z < begin + margin_px; ++z) add(z, 1);
    for (int64_t y = begin; y < end; ++y) {
      add(y + margin_px, 1);
      int32_t* face = map->face.data() + y * width;
      for (int x = 0; x < width;) {
        const void* const far = std::memchr(near.data() + x, 0, static_cast<size_t>(width - x));
        if (far == nullptr) break;
        for (x = static_cast<int>(static_cast<const uint8_t*>(far) - near.data()); x < width && near[x] == 0; ++x) {
          face[x] = -1;
        }
      }
      add(y - margin_px, 255);  // takes the row away
    }
  });
}

}  // namespace tessera
