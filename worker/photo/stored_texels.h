// Texels as they are stored, without padding, and the levels of a view.
#ifndef TESSERA_WORKER_PHOTO_STORED_TEXELS_H_
#define TESSERA_WORKER_PHOTO_STORED_TEXELS_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "common/imaging/raster.h"
#include "worker/photo/texels.h"
#include "worker/visibility/image_window.h"

namespace tessera {

// Levels that a view may have.
inline constexpr int kTexelLevels = 6;

// What there is of one level of a view.
struct TexelShape {
  PixelRect rect;                                                // of the level's whole image
  int classes = 0, likelihood_width = 0, likelihood_height = 0;  // zeros: no likelihoods
  PixelMapping mapping;                                          // from the level's whole image to likelihoods
  bool same_resolution = false;  // one likelihood a class for each pixel of `rect`, on this level and all others

  // Of the first level.
  static TexelShape First(const PixelRect& rect, int classes, int likelihood_width, int likelihood_height,
                          const PixelMapping& mapping);

  size_t pixels() const { return static_cast<size_t>(rect.width()) * rect.height(); }
  size_t likelihood_values() const { return static_cast<size_t>(likelihood_width) * likelihood_height * classes; }
  // Of the next level: half as many pixels each way, those that lie within `rect` as a whole; likelihoods likewise
  // where they have the same resolution, else the same ones.
  TexelShape Half() const;
};

// A part of one level in memory or in a mapped file, from which windows are brought to the inner loop. The owner of the
// pixels must outlive it. Const members are thread-safe.
struct StoredTexels : TexelShape {
  std::span<const uint16_t> luminance;   // rows of `rect`, as Texels::luminance
  std::span<const uint8_t> likelihoods;  // a plane a class, likelihood · Texels::kLikelihoodSteps
  std::function<void()> release;         // where there is one: the pixels are not needed for a while

  // The same where pixel (x, y) of the level's image is called (0, 0).
  StoredTexels CountedFrom(int x, int y) const;
  // Makes `texels`, whose arrays are used again, those of `window`, of even x0 and y0; invalid beyond `rect`.
  // Likelihoods are bilinear where they are coarser than the luminance, averaged over a pixel's footprint where finer;
  // their border is continued.
  void Bring(const PixelRect& window, Texels* texels) const;

  // The arrays of Half(): means of four, rounded; a luminance is invalid where one of the four is. Whole numbers, so
  // that all parts of a view have the same values.
  std::vector<uint16_t> HalfLuminance() const;
  std::vector<uint8_t> HalfLikelihoods() const;  // of the same resolution
};

}  // namespace tessera

#endif  // TESSERA_WORKER_PHOTO_STORED_TEXELS_H_
