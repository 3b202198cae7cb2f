// A view's pixels in memory.
#pragma once

#include <list>
#include <utility>
#include <vector>

#include "tests/support/make_texels.h"
#include "worker/photo/stored_texels.h"

namespace tessera {

// Of a whole image; `likelihoods` of any resolution, or empty.
class HeldPixels : public ViewPixels {
 public:
  explicit HeldPixels(const FloatImage& luminance, const FloatImage& likelihoods = FloatImage()) {
    std::vector<uint16_t> codes;
    for (const float value : luminance.data) codes.push_back(LuminanceCode(value));
    std::vector<uint8_t> steps;
    for (const float value : likelihoods.data) steps.push_back(LikelihoodStep(value));
    StoredTexels level;
    static_cast<TexelShape&>(level) = TexelShape::First(
        {0, 0, luminance.width, luminance.height}, likelihoods.empty() ? 0 : likelihoods.channels, likelihoods.width,
        likelihoods.height, likelihoods.empty() ? PixelMapping() : ScaleToSize(luminance, likelihoods));
    Hold(level, std::move(codes), std::move(steps));
    while (static_cast<int>(levels_.size()) < kTexelLevels) {
      const StoredTexels last = levels_.back();
      StoredTexels half;
      static_cast<TexelShape&>(half) = last.Half();
      Hold(half, last.HalfLuminance(), last.same_resolution ? last.HalfLikelihoods() : std::vector<uint8_t>());
      if (!last.same_resolution) levels_.back().likelihoods = last.likelihoods;
    }
  }
  const PixelRect& rect() const override { return levels_.front().rect; }
  bool has_likelihoods() const override { return levels_.front().classes > 0; }
  StatusOr<StoredTexels> Level(int level) const override { return levels_.at(level); }

 private:
  void Hold(StoredTexels level, std::vector<uint16_t> luminance, std::vector<uint8_t> likelihoods) {
    level.luminance = luminance_.emplace_back(std::move(luminance));
    level.likelihoods = likelihoods_.emplace_back(std::move(likelihoods));
    levels_.push_back(level);
  }

  std::vector<StoredTexels> levels_;
  std::list<std::vector<uint16_t>> luminance_;
  std::list<std::vector<uint8_t>> likelihoods_;
};

}  // namespace tessera
