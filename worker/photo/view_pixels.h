// Access to a view's pixels on demand: the pixels of all views of a tile do not fit in memory.
#pragma once

#include "common/base/status.h"
#include "worker/photo/stored_texels.h"
#include "worker/visibility/image_window.h"

namespace tessera {

// Pixels of a part of one view. Const members are thread-safe.
class ViewPixels {
 public:
  virtual ~ViewPixels() = default;
  // The part of the whole image.
  virtual const PixelRect& rect() const = 0;
  virtual bool has_likelihoods() const = 0;
  // A pyramid level, valid while this object lives. DATA_LOSS if the file is damaged.
  virtual StatusOr<StoredTexels> Level(int level) const = 0;
};

}  // namespace tessera
