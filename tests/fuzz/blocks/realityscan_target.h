// RealityScan's sidecars, which begin with <, and tables.
#pragma once

#include <string>

#include "common/blocks/block_parts.h"
#include "common/blocks/realityscan/realityscan.h"
#include "tests/fuzz/blocks/block_promises.h"

namespace tessera {

// Parses `bytes`; aborts if what comes out breaks a promise. True if it was taken as a camera or as a table.
inline bool RunRealityscanTarget(const std::string& bytes) {
  ImportedBlock block;
  Faults faults;
  if (bytes.starts_with("<")) {
    RealityScanCamera camera;
    const bool taken = ParseRealityScanXmp(bytes, "input", &camera, &faults);
    if (!Accepted(faults)) return false;
    if (!taken || !camera.has_focal) return taken;
    SharedCameras cameras(&block);
    BlockImage& image = block.images.emplace_back();
    image.path = "a.jpg";
    image.camera = cameras.IndexOf(RealityScanLens(camera, {400, 300}), "a");
    image.rotation_cam_from_block = camera.rotation_cam_from_block;
    image.centre = camera.position;
  } else {
    ParseRealityScanCsv(
        bytes, "input",
        [](const std::string&) {
          return ImageSize{400, 300};
        },
        &block, &faults);
    if (!Accepted(faults)) return false;
  }
  RequireBlock(block);
  return true;
}

}  // namespace tessera
