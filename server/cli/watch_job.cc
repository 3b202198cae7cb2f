#include "server/cli/watch_job.h"

#include <google/protobuf/util/json_util.h>

#include <cstdio>

#include "server/cli/command_line.h"
#include "server/display/progress_display.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

int Watch(Connection& connection, const std::string& name, const std::string& command,
          const std::function<void(const v1::WatchJobResponse&)>& show) {
  v1::Job job;
  const Status status = connection.WatchJob(name, [&](const v1::WatchJobResponse& update) {
    job = update.job();
    show(update);
  });
  if (!status.ok()) return ReportError(command, status);
  return ExitCodeOfJob(job, job.state() == v1::JOB_STATE_FAILED && connection.FailedForInput(name));
}

}  // namespace

int WatchJobWithProgress(Connection& connection, const std::string& job, const std::string& command) {
  ProgressDisplay display(stderr);
  return Watch(connection, job, command, [&](const v1::WatchJobResponse& update) { display.Show(update); });
}

int WatchJobAsJson(Connection& connection, const std::string& job, const std::string& command) {
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  options.always_print_primitive_fields = true;
  return Watch(connection, job, command, [&](const v1::WatchJobResponse& update) {
    std::string line;
    if (!google::protobuf::util::MessageToJsonString(update, &line, options).ok()) return;
    std::printf("%s\n", line.c_str());
    std::fflush(stdout);
  });
}

}  // namespace tessera
