// Training labels: images in which people painted classes.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/raster.h"
#include "common/scene/scene.h"

namespace tessera {

struct Annotation {
  size_t view = 0;
  std::string path;
  LabelImage labels;  // distorted, of the photograph's size; 255: not annotated
};

struct Annotations {
  std::vector<Annotation> images;  // sorted by view
  std::vector<int64_t> pixels;     // annotated pixels of each class
  int64_t annotated() const;       // annotated pixels of all classes
};

// Reads every PNG of `folder`. STEM.png or STEM_label.png annotates the image whose name without extension is STEM. A
// PNG with one 8-bit channel holds class ids, 255 where nothing is annotated. A PNG with colours uses those of the
// scene's classes; white, black and transparent pixels are not annotated. INVALID_ARGUMENT lists all errors: names
// without an image, two annotations of an image, a wrong size, unknown ids or colours, fewer than two annotated
// classes.
StatusOr<Annotations> ReadAnnotations(const std::string& folder, const SceneDescription& scene, Warnings* warnings);

}  // namespace tessera
