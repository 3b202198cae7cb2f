#include "server/client/export_job.h"

#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "common/storage/temporary_name.h"
#include "server/client/artifacts.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {

StatusOr<std::string> SubmitExport(Connection& connection, const std::string& job, const ExportSettings& settings) {
  v1::ExportJobRequest request;
  request.set_name(job);
  ToProto(settings, request.mutable_export_());
  request.set_request_id(UniqueName());
  v1::Job created;
  TESSERA_RETURN_IF_ERROR(connection.ExportJob(request, &created));
  return created.name();
}

StatusOr<std::vector<std::string>> FetchExports(Connection& connection, const std::string& name, const std::string& out,
                                                const TaskControl& control) {
  v1::Job job, exports;
  TESSERA_RETURN_IF_ERROR(connection.GetJob(name, &job));
  const std::string folder = kExportFolder;
  TESSERA_RETURN_IF_ERROR(TakeArtifacts(connection, folder, &job));
  for (const v1::Artifact& artifact : job.artifacts()) {
    v1::Artifact& added = *exports.add_artifacts();
    added = artifact;
    added.set_name(artifact.name().substr(folder.size()));
  }
  if (exports.artifacts_size() == 0) return absl::FailedPreconditionError(name + " has no exported files");
  TESSERA_RETURN_IF_ERROR(EnsureFolder(out));
  return FetchArtifacts(connection, exports, out, out + "/.fetch", control);
}

}  // namespace tessera
