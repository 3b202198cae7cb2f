// Going on without images whose files are missing or broken.
#pragma once

#include <vector>

#include "common/base/status.h"
#include "common/scene/scene.h"

namespace tessera {

// Removes the views with a fault from the scene and adds them to scene->skipped, with a warning (`warnings` may be
// null), if no more than `share` of all images are skipped then. Otherwise leaves the views, counts the faults in
// scene->unusable_images, and returns INVALID_ARGUMENT. `faults`: of each view, OK or why its image is unusable.
Status SkipImages(const std::vector<Status>& faults, double share, Warnings* warnings, SceneDescription* scene);

// Removes the elements with a fault from a list of one element per view, after SkipImages.
template <class Element>
void KeepUsable(const std::vector<Status>& faults, std::vector<Element>* list) {
  std::vector<Element> kept;
  for (size_t i = 0; i < faults.size(); ++i) {
    if (faults[i].ok()) kept.push_back(std::move((*list)[i]));
  }
  *list = std::move(kept);
}

// INVALID_ARGUMENT with the option that leaves out the unusable images; OK if there are none, or too many.
Status SkipAdvice(const SceneDescription& scene);

}  // namespace tessera
