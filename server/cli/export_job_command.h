// `tessera export JOB`: exports the result of a job of a coordinator.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/exporting/export_format.h"
#include "common/rpc/channel.h"

namespace tessera {

// Submits the export as a job of its own, shows its progress, and writes its files to `out`, a folder a format. Returns
// the exit code, as `tessera watch`.
StatusOr<int> ExportResultOfJob(const Endpoint& coordinator, const std::string& job, const ExportOptions& options,
                                const std::string& out);

}  // namespace tessera
