// Scenes in an object store: sending one from a folder, and describing one that lies there.
#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/s3/s3_client.h"
#include "common/scene/manifest.h"

namespace tessera {

struct SceneUpload {
  SceneManifest manifest;  // as it was stored
  int64_t bytes = 0;       // of all files
  int64_t sent_files = 0;  // the others were in the store with the same size and hash
};

// Sends all files of the scene in `folder` to the client's location, several at once, and the manifest last. Files
// whose names or folders begin with a dot are left out. A file that is in the store with the same size and hash
// (S3Object::sha256) is not sent again, so an interrupted upload goes on when repeated. INVALID_ARGUMENT without
// scene.json; DATA_LOSS if a file changes meanwhile; CANCELLED by `control`; errors of S3Client. Without an error no
// file of `folder` that was there at the start is missing in the manifest.
StatusOr<SceneUpload> UploadScene(const std::string& folder, S3Client& client, const TaskControl& control);

// Reads all objects of the client's location once and stores their manifest. Keeps each image in `scratch`, an existing
// folder, while its header is read. Errors as of UploadScene; ABORTED if an object changes meanwhile.
StatusOr<SceneUpload> DescribeStoredScene(S3Client& client, const std::string& scratch, const TaskControl& control);

}  // namespace tessera
