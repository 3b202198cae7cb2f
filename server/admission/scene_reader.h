// Reads and validates the scene of a submission and selects its classifier.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/exporting/export_scene.h"
#include "common/scene/scene.h"
#include "common/scene/stored_scenes.h"
#include "common/storage/allowed_files.h"
#include "common/storage/hash.h"

namespace tessera {

struct SceneRequest {
  bool needs_mesh = true;        // false: the scene adds images to a base job's
  std::string classifier;        // as in JobSettings
  bool base_classifies = false;  // the base job computes likelihoods, so those of the scene are not read
  double skip_images = 0;        // as in JobSettings
};

struct SceneListing {
  std::string folder;  // absolute, or s3://BUCKET/PREFIX
  std::string name;
  std::vector<std::string> files;  // relative to folder, sorted
  Warnings warnings;
  // As in JobSettings. If the request has none: the default classifier, if the scene needs one and has its classes.
  std::string classifier = {};
  std::string classifier_content = {};  // of a trained classifier
  ExportScene place = {};               // where the scene lies, for exports; without its GSD and ground
  SceneDescription scene = {};          // with its poses, for a quote
  // Of a scene in an object store: the digests of `files`, as its manifest has them. Else empty.
  std::vector<NamedDigest> digests = {};
};

// Reads and validates the scene at `path`, a folder or its scene.json. Opens only what is allowed. INVALID_ARGUMENT
// with all faults of the scene and the classifier, one a line; NOT_FOUND for a classifier that does not exist.
// Thread-safe.
StatusOr<SceneListing> ReadScene(const std::string& path, const SceneRequest& request, const AllowedFiles& allowed);

// The same for a scene in an object store. `allowed`: for the classifier. CANCELLED by `cancelled`, which may be empty.
StatusOr<SceneListing> ReadStoredScene(const std::string& url, const SceneRequest& request, const AllowedFiles& allowed,
                                       const StoredScenes& scenes, const std::function<bool()>& cancelled);

// ReadScene, or a replacement in tests.
using SceneReader = std::function<StatusOr<SceneListing>(const std::string& path, const SceneRequest& request,
                                                         const AllowedFiles& allowed)>;

}  // namespace tessera
