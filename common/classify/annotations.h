// Pictures in which people painted classes.
#ifndef TESSERA_COMMON_CLASSIFY_ANNOTATIONS_H_
#define TESSERA_COMMON_CLASSIFY_ANNOTATIONS_H_

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/raster.h"
#include "common/scene/scene.h"

namespace tessera {

struct Annotation {
  size_t view = 0;
  std::string path;
  LabelImage labels;  // in the image's own frame and size; 255: not annotated
};

struct Annotations {
  std::vector<Annotation> images;  // by view
  std::vector<int64_t> pixels;     // of each class
  int64_t annotated() const;
};

// Every PNG of `folder`: STEM.png or STEM_label.png annotates the image whose name without extension is STEM. One
// channel of 8 bits: class numbers, 255 where nothing is annotated. Colours: those of the scene's classes; white, black
// and what is transparent is not annotated. All faults at once: names that no image has, an image twice, another size,
// numbers and colours that no class has, fewer than two classes in all.
StatusOr<Annotations> ReadAnnotations(const std::string& folder, const SceneDescription& scene, Warnings* warnings);

}  // namespace tessera

#endif  // TESSERA_COMMON_CLASSIFY_ANNOTATIONS_H_
