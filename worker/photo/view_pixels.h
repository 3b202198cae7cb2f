// Where a view's pixels come from whenever they are needed: those of a tile's views together are too many to be held.
#ifndef TESSERA_WORKER_PHOTO_VIEW_PIXELS_H_
#define TESSERA_WORKER_PHOTO_VIEW_PIXELS_H_

#include "common/base/status.h"
#include "worker/photo/stored_texels.h"
#include "worker/visibility/image_window.h"

namespace tessera {

// The pixels of a part of one view. Const members are thread-safe.
class ViewPixels {
 public:
  virtual ~ViewPixels() = default;
  // What part of the whole image.
  virtual const PixelRect& rect() const = 0;
  virtual bool has_likelihoods() const = 0;
  // A level of the pyramid, valid as long as this lives. DATA_LOSS if the file is damaged.
  virtual StatusOr<StoredTexels> Level(int level) const = 0;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_PHOTO_VIEW_PIXELS_H_
