// Texels on disk while nobody looks at them.
#ifndef TESSERA_WORKER_REFINE_SPILLED_TEXELS_H_
#define TESSERA_WORKER_REFINE_SPILLED_TEXELS_H_

#include <string>

#include "common/base/status.h"
#include "common/storage/mapped_file.h"
#include "worker/refine/texels.h"
#include "worker/visibility/image_window.h"

namespace tessera {

// One view's texels in a file without a name. Const members are thread-safe.
class SpilledTexels {
 public:
  SpilledTexels() = default;  // of none
  // Takes the arrays out of `texels`, which keeps everything else. RESOURCE_EXHAUSTED if the disk of `folder` is full.
  static StatusOr<SpilledTexels> Spill(const std::string& folder, Texels* texels);
  // All that there is, in the whole image of the level.
  const PixelRect& rect() const { return rect_; }
  // Makes `texels`, whose arrays are used again, a copy of the part in `rect`: within rect(), of even x0 and y0.
  void Bring(const PixelRect& rect, Texels* texels) const;

 private:
  MappedFile file_;
  PixelRect rect_;
  int stride_ = 0, classes_ = 0;
  size_t pixels_ = 0, planes_ = 0;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_SPILLED_TEXELS_H_
