// A block of another program and its mesh become a scene.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/importing/frames.h"
#include "common/importing/image_paths.h"
#include "common/importing/write_scene.h"

namespace tessera {

struct ImportOptions {
  std::string source;                 // the block's file or folder
  std::optional<std::string> format;  // name of a BlockFormat; none: detected by content
  std::string mesh;                   // file or folder; empty: the mesh of the source's folder, if there is one
  PhotographSearch photographs;
  bool copy_images = false;
  std::string crs;       // replaces that of the source; "local": none; empty: that of the source
  std::string mesh_crs;  // the same for the mesh; empty: that of its files, else that of the block
  HeightOptions heights;
  std::optional<FrameChoice> frame;  // none: the one that the tie points fit better
  std::string labels = "none";       // none, material, property:NAME
  std::string class_file;            // names of materials or labels to classes
  int component = -1;                // -1: the one with most images
  std::vector<FlightPattern> flights;
  double max_error_px = 1.5;  // of the median of residuals
  bool anyway = false;        // warn where images, poses and mesh do not fit, instead of refusing
};

struct ImportResult {
  std::string text;  // the table for users
  std::string json;  // content of import.json
};

// Writes the scene to the folder `out`, which must be new or empty and appears whole or not at all. INVALID_ARGUMENT
// with all faults of the source, its images and its mesh, and if the poses do not fit the tie points (ProveByTiePoints)
// or the images do not fit the mesh (CheckScene). ALREADY_EXISTS if `out` has files. CANCELLED by `control`.
StatusOr<ImportResult> ImportScene(const ImportOptions& options, const std::string& out, Warnings* warnings,
                                   const TaskControl& control);

}  // namespace tessera
