// Writes an imported block as a scene.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/blocks/block.h"
#include "common/geodesy/frame.h"
#include "common/importing/image_paths.h"
#include "common/scene/scene_json.h"

namespace tessera {

struct FlightPattern {
  std::string name;
  std::string images;  // glob on names of images
};

// Reads "NAME=GLOB", the value of --flight. INVALID_ARGUMENT without '=' or with an empty part.
StatusOr<FlightPattern> ParseFlightPattern(const std::string& text);

struct ImportedScene {
  std::string name;
  const ImportedBlock* block = nullptr;  // in scene coordinates
  std::vector<FoundImage> images;        // of each image of the block; those without a file are left out
  Crs crs;
  std::optional<SceneSource> source;     // none: no reference system and no mesh
  std::vector<std::string> class_names;  // of the mesh's labels; empty without labels
  std::vector<FlightPattern> flights;
  bool has_labels = false;   // mesh.ply has labels
  bool copy_images = false;  // false: images/ has links to the files
};

// Writes scene.json, colmap/ (text) and images/ to `folder`, which exists.
Status WriteScene(const ImportedScene& scene, const std::string& folder);

}  // namespace tessera
