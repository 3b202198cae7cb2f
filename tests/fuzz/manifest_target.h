// tessera.manifest.json.
#pragma once

#include <string>

#include "common/scene/manifest.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// True if it was taken as a manifest.
inline bool RunManifestTarget(const std::string& bytes) {
  const StatusOr<SceneManifest> manifest = ParseManifest(bytes, "tessera.manifest.json");
  if (!manifest.ok()) {
    RequireRefusal(manifest.status());
    return false;
  }
  for (const ManifestFile& file : manifest->files) {
    Require(CheckDigest(file.digest).ok(), "a file has a digest");
    Require(("/" + file.name + "/").find("/../") == std::string::npos && file.name.front() != '/',
            "names stay inside the scene");
    Require(!file.image || (file.image->size.width > 0 && file.image->size.height > 0), "an image has a size");
    Require(FindFile(*manifest, file.name) == &file, "a file is found by its name");
  }
  const std::string written = ToJson(*manifest);
  const StatusOr<SceneManifest> again = ParseManifest(written, "tessera.manifest.json");
  Require(again.ok() && ToJson(*again) == written, "what is written is read as it was");
  return true;
}

}  // namespace tessera
