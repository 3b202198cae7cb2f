// Downloads the files that a job published.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/client/connection.h"

namespace tessera {

// Downloads every artifact of `job` to `staging` and verifies it. When all are complete, moves each to `out` under its
// name and replaces existing files; mesh.ply is last. Archives of sheets (SheetArchiveName) are unpacked in their
// place. Removes `staging`. Returns the written paths. `staging`: on the same file system as `out`; a repeated call
// resumes an interrupted one. CANCELLED by `control`.
StatusOr<std::vector<std::string>> FetchArtifacts(Connection& connection, const v1::Job& job, const std::string& out,
                                                  const std::string& staging, const TaskControl& control);

}  // namespace tessera
