// The files that a job published, into a folder of the user's.
#ifndef TESSERA_SERVER_CLIENT_ARTIFACTS_H_
#define TESSERA_SERVER_CLIENT_ARTIFACTS_H_

#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/client/connection.h"

namespace tessera {

// Downloads every artifact of `job` to `staging` (on the same file system as `out`; what an interrupted call left there
// is gone on with), verifies it, and only when all are there moves each into `out` under its name, replacing what was
// there; mesh.ply last. Removes `staging`. Gives the paths written. CANCELLED by `control`.
StatusOr<std::vector<std::string>> FetchArtifacts(Connection& connection, const v1::Job& job, const std::string& out,
                                                  const std::string& staging, const TaskControl& control);

}  // namespace tessera

#endif  // TESSERA_SERVER_CLIENT_ARTIFACTS_H_
