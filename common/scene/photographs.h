// Photographs as producers have them: masks, alpha channels, scaled copies, tags, and samples of fewer bits than their
// files have.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/imaging/image_header.h"
#include "common/imaging/image_io.h"
#include "common/scene/scene.h"

namespace tessera {

// How the view's image below `folder` is read.
PhotographOptions OptionsOf(const std::string& folder, const SceneView& view);

// The files of masks, relative to the masks folder, per view; empty: none. `files`: all files of the folder, sorted.
// The mask of "x/a.jpg" is "x/a.jpg.png", "x/a.mask.png" or "x/a.png"; the latter two only if no other image has this
// stem. Adds to `faults`: several masks of an image, one for several images. Warns of files that belong to no image,
// and if not all images have masks. `folder`: as messages name it.
std::vector<std::string> FindMaskFiles(const SceneDescription& scene, const std::vector<std::string>& files,
                                       const std::string& folder, Warnings* warnings, Faults* faults);

// Compares the images with their cameras. If all have the same multiple of their cameras' sizes, the intrinsics of all
// views are scaled, with a warning; else returns the error of each view whose image has another size. Also warns of
// orientation tags. `headers`: per view; none: unknown. `folder`: of the images, as warnings name it.
std::vector<Status> FitLenses(const std::vector<std::optional<ImageHeader>>& headers, const std::string& folder,
                              SceneDescription* scene, Warnings* warnings);

// Sets white_level of the views with 16-bit images: of each flight, the largest number of 8, 10, 11, 12 or 14 bits if
// no image of the flight has a higher sample (HighestSample); 0 for all others. Decodes 16-bit images until one has a
// higher sample. Warns of what it sets. `is_read`: per view; false: the image is not there, its white_level is kept,
// and others of its flight get at least that. `known`: highest samples by image_path, of images that need not be
// decoded. Images that cannot be read are left to the caller. CANCELLED.
Status ChooseWhiteLevels(const std::vector<uint8_t>& is_read, const TaskControl& control, SceneDescription* scene,
                         Warnings* warnings, const std::map<std::string, int>& known = {});

}  // namespace tessera
