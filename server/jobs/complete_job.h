// Completes a submitted job with the settings and files of its base job.
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
  std::string client;  // that submits it
  // Content of kClassifierFile in scene_files, stored with the job. May be empty for an update.
  std::string classifier = {};
};

// The job as it would be accepted. An update gets the settings of its base and the base's files that its scene lacks; a
// rollback gets the base's scene and, if it names no tiles, all tiles that differ; an export the base's scene. Fails
// with an error for the user if the job cannot be planned; UNAVAILABLE while the base's survey is recomputed. Call
// without the core's mutex.
StatusOr<NewJob> CompleteJob(DispatchCore& core, Recovery& recovery, NewJob job);

}  // namespace tessera
