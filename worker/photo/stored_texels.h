// Storage format of texels, without padding, and the pyramid levels of a view.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/raster.h"
#include "worker/photo/texels.h"
#include "worker/visibility/image_window.h"

namespace tessera {

// Maximum number of pyramid levels.
inline constexpr int kTexelLevels = 6;

// Shape of the stored part of one level.
struct TexelShape {
  PixelRect rect;                                                // of the level's whole image
  int classes = 0, likelihood_width = 0, likelihood_height = 0;  // zeros: no likelihoods
  PixelMapping mapping;          // from pixels of the level's whole image to likelihoods
  bool same_resolution = false;  // one likelihood per class and pixel of `rect`, on all levels

  // The shape of level 0.
  static TexelShape First(const PixelRect& rect, int classes, int likelihood_width, int likelihood_height,
                          const PixelMapping& mapping);

  size_t pixels() const { return static_cast<size_t>(rect.width()) * rect.height(); }
  size_t likelihood_values() const { return static_cast<size_t>(likelihood_width) * likelihood_height * classes; }
  // The shape of the next level: half the pixels in each direction, those fully inside `rect`. Likelihoods are halved
  // if they have the same resolution, else unchanged.
  TexelShape Half() const;
};

// Part of one level, in memory or in a mapped file, from which windows are loaded for the kernel. The owner of the
// pixels must outlive it. Const members are thread-safe.
struct StoredTexels : TexelShape {
  std::span<const uint16_t> luminance;   // rows of `rect`, as Texels::luminance
  std::span<const uint8_t> likelihoods;  // one plane per class, likelihood · Texels::kLikelihoodSteps
  std::function<void()> release;         // optional hint: the pixels are not needed for a while
  // Optional, of a mapped file: copies bytes of the two arrays from the file, so that LoadWindow maps no pages. Mapping
  // and releasing them takes longer than copying. False if the file cannot be read. Called from several threads.
  std::function<bool(const void* from, size_t size_bytes, void* to)> copy;

  // The same with the pixel origin moved to pixel (x, y) of the level's image.
  StoredTexels WithOrigin(int x, int y) const;
  // Loads `window` (even x0 and y0) into `texels`, reusing its arrays; pixels outside `rect` are invalid. Likelihoods
  // are interpolated bilinearly if coarser than the luminance, averaged over a pixel's footprint if finer, and their
  // border values are repeated. Runs on all threads.
  void LoadWindow(const PixelRect& window, Texels* texels) const;

  // Arrays of Half(): rounded means of four values; a luminance is invalid if one of the four is. Integer arithmetic,
  // so that all parts of a view have the same values.
  std::vector<uint16_t> HalfLuminance() const;
  std::vector<uint8_t> HalfLikelihoods() const;  // requires same_resolution
};

// Pixels of a part of one view. Const members are thread-safe.
class ViewPixels {
 public:
  virtual ~ViewPixels() = default;
  // The part of the whole image that the view's user needs.
  virtual const PixelRect& rect() const = 0;
  virtual bool has_likelihoods() const = 0;
  // A pyramid level of this part, or of more. Valid while this object lives. DATA_LOSS if the file is damaged.
  virtual StatusOr<StoredTexels> Level(int level) const = 0;
};

}  // namespace tessera
