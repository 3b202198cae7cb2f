#include "server/cli/export_job_command.h"

#include <cstdio>

#include "common/base/printable.h"
#include "common/storage/files.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/connection.h"
#include "server/client/export_job.h"
#include "server/client/job_text.h"

namespace tessera {

StatusOr<int> ExportResultOfJob(const Endpoint& coordinator, const std::string& job, const ExportOptions& options,
                                const std::string& out) {
  const ExportSettings settings = {options.formats, options.crs, std::string(VertexColorName(options.color)),
                                   options.gsd_m, options.class_materials};
  TESSERA_ASSIGN_OR_RETURN(const auto connection, Connection::Open(coordinator));
  TESSERA_ASSIGN_OR_RETURN(const std::string name, SubmitExport(*connection, FullJobName(job), settings));
  TESSERA_ASSIGN_OR_RETURN(const int code, WatchJobWithProgress(*connection, name));
  if (code != kExitOk) return code;
  TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> written,
                           FetchExports(*connection, name, AbsolutePath(out), TaskControl()));
  for (const std::string& path : written) std::printf("%s\n", Printable(path).c_str());
  return kExitOk;
}

}  // namespace tessera
