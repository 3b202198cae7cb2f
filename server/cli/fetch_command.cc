// `tessera fetch`: downloads a job's results.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <vector>

#include "common/base/clock.h"
#include "common/storage/files.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/artifacts.h"
#include "server/client/connection.h"
#include "server/client/job_text.h"
#include "server/client/tile_changes.h"
#include "server/client/timeline.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

struct FetchFlags {
  Endpoint coordinator;
  std::string job;
  std::string changed_since;
  std::string out;
  std::string timeline;
};

// Removes unchanged tile meshes from the artifacts of `job`. Returns the old and new hash of each tile mesh.
StatusOr<std::vector<TileFileChange>> RemoveUnchanged(const v1::Job& base, v1::Job* job) {
  for (const v1::Job* each : {&base, static_cast<const v1::Job*>(job)}) {
    if (HasResult(each->state())) continue;
    return absl::FailedPreconditionError(each->name() + " is " + JobStateName(each->state()) +
                                         ", expected a job with a result: --changed-since compares results");
  }
  std::vector<TileFileChange> changes = CompareTileFiles(base, *job);
  if (std::all_of(changes.begin(), changes.end(), [](const auto& change) { return change.new_sha256.empty(); })) {
    return absl::FailedPreconditionError(
        job->name() + " has no tile meshes (it has one tile, or is a plan): fetch it without --changed-since");
  }
  *job = OnlyChanged(*job, changes);
  return changes;
}

StatusOr<int> FetchResults(Connection& connection, const FetchFlags& flags) {
  v1::Job job, base;
  TESSERA_RETURN_IF_ERROR(connection.GetJob(FullJobName(flags.job), &job));
  if (!HasEnded(job.state())) {
    return absl::FailedPreconditionError(job.name() + " is " + JobStateName(job.state()) +
                                         " and has no result yet; wait for it with: tessera watch " + job.name());
  }
  TESSERA_RETURN_IF_ERROR(TakeArtifacts(connection, "", &job));
  if (job.artifacts_size() == 0) {
    return absl::FailedPreconditionError(job.name() + " is " + JobStateName(job.state()) + " and has no result");
  }
  std::vector<TileFileChange> changes;
  if (!flags.changed_since.empty()) {
    TESSERA_RETURN_IF_ERROR(connection.GetJob(FullJobName(flags.changed_since), &base));
    TESSERA_RETURN_IF_ERROR(TakeArtifacts(connection, "", &base));
    TESSERA_ASSIGN_OR_RETURN(changes, RemoveUnchanged(base, &job));
  }
  const std::string out = AbsolutePath(flags.out);
  TESSERA_RETURN_IF_ERROR(EnsureFolder(out));
  const std::string changes_path = out + "/changed.json";
  // Remove the file of an earlier fetch: changed.json is present only when all files that it lists are.
  if (!flags.changed_since.empty()) TESSERA_RETURN_IF_ERROR(RemoveTree(changes_path));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> written,
                           FetchArtifacts(connection, job, out, out + "/.fetch", {}));
  for (const std::string& path : written) std::printf("%s\n", path.c_str());
  if (flags.changed_since.empty()) {
    if (const std::string page = WritePageOrWarn(job, out); !page.empty()) std::printf("%s\n", page.c_str());
    return kExitOk;
  }
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(changes_path, ChangesJson(base, job, changes)));
  const auto changed =
      std::count_if(changes.begin(), changes.end(), [](const auto& change) { return change.changed(); });
  std::printf("%s\n%td of %zu tile meshes changed since %s\n", changes_path.c_str(), changed, changes.size(),
              base.name().c_str());
  return kExitOk;
}

StatusOr<int> Fetch(const FetchFlags& flags) {
  TESSERA_ASSIGN_OR_RETURN(const auto connection, Connection::Open(flags.coordinator));
  if (!flags.timeline.empty()) {
    TESSERA_RETURN_IF_ERROR(WriteTimeline(*connection, FullJobName(flags.job), SystemClock(), flags.timeline));
    std::printf("%s\n", flags.timeline.c_str());
  }
  return flags.out.empty() ? kExitOk : FetchResults(*connection, flags);
}

}  // namespace

void AddFetchCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<FetchFlags>();
  CLI::App* command = app.add_subcommand("fetch", "Download a job's results into a folder");
  command->footer(
      "Checks every file against its hash. Files appear in OUT only when all are complete; an interrupted fetch "
      "resumes\n"
      "when repeated. Then report.html shows the result as one page with pictures and plots, for any browser; the "
      "start\n"
      "mesh is among them if the job's scene can be read here.\n"
      "With --changed-since, downloads only tile meshes whose bytes differ from those of the other "
      "job,\n"
      "and all JSON files, but not mesh.ply; changed.json lists the old and new SHA-256 of every tile mesh (null: no\n"
      "such file). A published job never changes: fetch an earlier job for an earlier state of the city.\n"
      "Examples:\n"
      "  tessera fetch jobs/7 --out result\n"
      "  tessera fetch jobs/7 --changed-since jobs/3 --out changed\n"
      "  tessera fetch jobs/7 --timeline timeline.json");
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "The job's name or number")->required();
  CLI::Option* const out =
      command->add_option("--out", flags->out, "Folder for mesh.ply, report.json, report.html and the other results");
  command
      ->add_option("--changed-since", flags->changed_since,
                   "Download only tile meshes that differ from those of this job")
      ->needs(out);
  command->add_option("--timeline", flags->timeline,
                      "Write a Chrome trace of the job's attempts, one track per worker, to this file; open it with "
                      "ui.perfetto.dev. The job may be in any state");
  command->parse_complete_callback([flags] {
    if (flags->out.empty() && flags->timeline.empty())
      throw CLI::ValidationError("found neither --out nor --timeline, expected at least one of them");
  });
  SetAction(command, exit_code, [flags] { return Fetch(*flags); });
}

}  // namespace tessera
