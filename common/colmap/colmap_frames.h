// Rigs and frames of COLMAP 3.12 and later: files that hold the poses of the images a second time.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/colmap/colmap_compare.h"

namespace tessera {

// A frame is a moment at which the cameras of a rig took images: cam_from_world = cam_from_rig · rig_from_world.
struct ColmapFrames {
  struct Image {
    uint64_t image_id = 0;
    uint32_t rig_id = 0, camera_id = 0;
    RigidPose rig_from_world;
  };
  std::map<std::pair<uint32_t, uint32_t>, RigidPose> cam_from_rig;  // by rig and camera; only known poses
  std::vector<Image> images;
};

// Read the contents of rigs.txt and frames.txt, or of rigs.bin and frames.bin. `folder` is the path in messages.
ColmapFrames ParseColmapFramesText(const std::string& rigs, const std::string& frames, const std::string& folder,
                                   Faults* faults);
ColmapFrames ParseColmapFramesBinary(const std::string& rigs, const std::string& frames, const std::string& folder,
                                     Faults* faults);

// Reports the image whose pose differs most from that of its frame, if any differs by more than rounding: one of the
// two files is stale. Images without a frame are not compared. `extension`: of the model's files.
void CompareWithFrames(const CalibratedImages& model, const ColmapFrames& frames, const std::string& folder,
                       const std::string& extension, Faults* faults);

}  // namespace tessera
