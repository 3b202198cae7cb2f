// A job as a user submits it, and what it takes over from its base job.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/jobs/recovery.h"
#include "server/leases/dispatch_core.h"

namespace tessera {

struct NewJob {
  JobRequest request;
  std::string display_name;
  std::string scene_path;  // absolute
  JobSettings settings;
  std::vector<NamedDigest> scene_files;
  Warnings warnings;
  int priority = 0;
  std::string client;  // who submits it
  // Content of the kClassifierFile among scene_files, which is stored with the job; of an update it may be empty.
  std::string classifier = {};
};

// The job as it would be accepted: an update with its base's settings and with the files of the base that its scene
// lacks; a rollback with its base's scene and, if it names no tiles, all tiles that differ. Errors, for the user, if
// its settings and scene cannot be planned; UNAVAILABLE while the base's survey is made again.
StatusOr<NewJob> CompleteJob(DispatchCore& core, Recovery& recovery, NewJob job);

}  // namespace tessera
