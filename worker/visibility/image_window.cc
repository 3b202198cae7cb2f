#include "worker/visibility/image_window.h"

namespace tessera {

PosedCamera PyramidCamera(const PosedCamera& camera, int level) {
  PosedCamera out = camera;
  PinholeCamera& k = out.intrinsics;
  for (int i = 0; i < level; ++i) {
    k.width &= ~1;
    k.height &= ~1;
    k = k.Resized(k.width / 2, k.height / 2);
  }
  return out;
}

}  // namespace tessera
