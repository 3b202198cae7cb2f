// Where a view's pixels come from whenever they are needed: those of a tile's views together are too many to be held.
#ifndef TESSERA_WORKER_REFINE_VIEW_PIXELS_H_
#define TESSERA_WORKER_REFINE_VIEW_PIXELS_H_

#include "common/base/status.h"
#include "common/imaging/raster.h"

namespace tessera {

// The pixels of a part of one view. Const members are thread-safe.
class ViewPixels {
 public:
  virtual ~ViewPixels() = default;
  // Of the luminance.
  virtual int width() const = 0;
  virtual int height() const = 0;
  // Values in [0, 1], NaN where the photograph has nothing. DATA_LOSS if the file is damaged.
  virtual StatusOr<FloatImage> Luminance() const = 0;
  virtual bool has_likelihoods() const = 0;
  // A plane a class, in [0, 1], of any resolution. Errors as Luminance's.
  virtual StatusOr<FloatImage> Likelihoods() const = 0;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_VIEW_PIXELS_H_
