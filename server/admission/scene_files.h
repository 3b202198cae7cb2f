// Files of scenes: what a job reads, by content; hashed once, and known to be unchanged later.
#ifndef TESSERA_SERVER_ADMISSION_SCENE_FILES_H_
#define TESSERA_SERVER_ADMISSION_SCENE_FILES_H_

#include <functional>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/storage/allowed_files.h"
#include "common/storage/hash.h"
#include "server/store/record_store.h"

namespace tessera {

// What is asked of a scene.
struct SceneRequest {
  bool needs_mesh = true;        // else it adds to another
  std::string classifier;        // as JobSettings
  bool base_classifies = false;  // so likelihoods are not looked at, whatever `classifier` says
};

// What a coordinator needs to know of a scene.
struct SceneListing {
  std::string folder;  // absolute
  std::string name;
  std::vector<std::string> files;  // relative to folder, sorted
  Warnings warnings;
  // As JobSettings, settled: where it was empty the default, if the scene needs one.
  std::string classifier = {};
  std::string classifier_content = {};  // of a trained one
};

// Reads and validates the scene at a path, opening nothing but what is allowed; every fault is in the returned
// INVALID_ARGUMENT; also those of the classifier, which is opened too. Thread-safe.
using SceneLister = std::function<StatusOr<SceneListing>(const std::string& path, const SceneRequest& request,
                                                         const AllowedFiles& allowed)>;

// Whether nobody waits for an answer any more. May be empty.
using Cancelled = std::function<bool()>;

// Digest of the open file as it is now: remembered by its real path while its size and time of change stay the same,
// else computed. FAILED_PRECONDITION if it changes while it is read, CANCELLED. Thread-safe.
StatusOr<Digest> DigestOfFile(const HeldFile& file, DigestCache& cache, const Clock& clock,
                              const Cancelled& cancelled = {});

// Digests of all files of the scene, in their order, several at a time. INVALID_ARGUMENT lists every file that cannot
// be read, or is not among those that may be.
StatusOr<std::vector<NamedDigest>> DigestSceneFiles(const SceneListing& scene, const AllowedFiles& allowed,
                                                    DigestCache& cache, const Clock& clock,
                                                    const Cancelled& cancelled = {});

}  // namespace tessera

#endif  // TESSERA_SERVER_ADMISSION_SCENE_FILES_H_
