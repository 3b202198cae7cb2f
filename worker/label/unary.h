// What the images say about the class of each face: likelihoods summed over the pixels that see it.
#ifndef TESSERA_WORKER_LABEL_UNARY_H_
#define TESSERA_WORKER_LABEL_UNARY_H_

#include <cstddef>
#include <vector>

#include "common/imaging/raster.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Sums over all views added so far, face by face.
struct FaceLikelihoods {
  int classes = 0;
  std::vector<float> sum;     // faces x classes: the likelihoods of the pixels that see the face, added up
  std::vector<float> pixels;  // faces: how many pixels

  FaceLikelihoods(size_t faces, int class_count)
      : classes(class_count), sum(faces * class_count, 0.0f), pixels(faces, 0.0f) {}
  size_t faces() const { return pixels.size(); }
};

// Adds one view: each pixel of `map` that sees a face adds the likelihoods where `mapping` puts it (a plane a class;
// bilinear, the border continued). Not thread-safe on the same `sums`.
void AddLikelihoods(const FaceMap& map, const FloatImage& likelihoods, const PixelMapping& mapping,
                    FaceLikelihoods* sums);

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_UNARY_H_
