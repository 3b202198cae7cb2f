// The manifest of a scene in an object store: what a coordinator needs to know of files that it does not open.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/image_header.h"
#include "common/storage/hash.h"

namespace tessera {

inline constexpr char kManifestName[] = "tessera.manifest.json";  // beside scene.json
inline constexpr int64_t kMaxManifestBytes = int64_t{256} << 20;  // about a million files

struct ManifestFile {
  std::string name;  // relative to the scene's folder
  Digest digest;
  std::optional<ImageHeader> image = {};  // of a file that is an image (JPEG, PNG, TIFF)
  // Why the header of a file that should be an image cannot be read; InputFault::file is not used.
  std::optional<InputFault> fault = {};
  // Of a file of a camera model (IsOfCameraModel): its modification time, Unix time; 0: unknown. Of two models that
  // differ the newer one is read.
  int64_t modified_ns = 0;
};

struct SceneManifest {
  std::vector<ManifestFile> files;  // sorted by name; each once
};

// Whether a manifest has a file of this name: not if the name or a folder's begins with a dot, nor the manifest itself.
bool IsPartOfScene(const std::string& name);

// Whether ReadColmapModel may open a file of this name, in any folder.
bool IsOfCameraModel(const std::string& name);

// The file of this name; null if there is none.
const ManifestFile* FindFile(const SceneManifest& manifest, const std::string& name);

// OK, or the fault of the file, whose name begins with `folder` in the message.
Status FaultOf(const ManifestFile& file, const std::string& folder);

// Reads a manifest, which is untrusted. `file`: its name in messages. INVALID_ARGUMENT with the first fault and its
// place. Names have no empty, "." and ".." parts and no control characters. Unknown keys are ignored.
StatusOr<SceneManifest> ParseManifest(const std::string& text, const std::string& file);

// Deterministic: equal manifests give equal bytes. Sorts the files.
std::string ToJson(SceneManifest manifest);

// Whether a file is an image: by its name (.jpg, .jpeg, .png, .tif, .tiff, in upper or lower case), or by its first
// bytes.
bool MayBeImage(const std::string& name, std::string_view head);

// Sets `image` or `fault` from the header of the local file at `path`, if it is an image (MayBeImage).
void ReadImageFacts(const std::string& path, ManifestFile* file);

}  // namespace tessera
