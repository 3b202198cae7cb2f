// Downloads the files that a job published.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/client/connection.h"

namespace tessera {

// Keeps those artifacts of the job whose names start with `prefix`, all of them: a job as calls return it has only the
// first 1,000 (Job.artifacts). Errors of ListArtifacts.
Status TakeArtifacts(Connection& connection, const std::string& prefix, v1::Job* job);

// Downloads every artifact that `job` lists (after TakeArtifacts) to `staging` and verifies it. When all are complete,
// moves each to `out` under its name and replaces existing files; mesh.ply is last. Archives of sheets
// (SheetArchiveName) are unpacked in their place. Removes `staging`. Returns the written paths. `staging`: on the same
// file system as `out`; a repeated call resumes an interrupted one. CANCELLED by `control`.
StatusOr<std::vector<std::string>> FetchArtifacts(Connection& connection, const v1::Job& job, const std::string& out,
                                                  const std::string& staging, const TaskControl& control);

}  // namespace tessera
