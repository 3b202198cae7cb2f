// `tessera fetch`: brings a job's results.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <vector>

#include "common/storage/files.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/artifacts.h"
#include "server/client/connection.h"
#include "server/client/job_words.h"
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

// Takes from `job` what need not be fetched, and gives what the tiles' meshes were and are.
StatusOr<std::vector<TileFileChange>> LeaveOutUnchanged(const v1::Job& base, v1::Job* job) {
  for (const v1::Job* each : {&base, static_cast<const v1::Job*>(job)}) {
    if (HasResult(each->state())) continue;
    return absl::FailedPreconditionError(each->name() + " is " + JobStateWord(each->state()) +
                                         ": --changed-since compares results");
  }
  std::vector<TileFileChange> changes = CompareTileFiles(base, *job);
  if (std::all_of(changes.begin(), changes.end(), [](const auto& change) { return change.new_sha256.empty(); })) {
    return absl::FailedPreconditionError(job->name() +
                                         " has no tiles' meshes (it is of one tile, or a plan): fetch all of it");
  }
  *job = OnlyChanged(*job, changes);
  return changes;
}

int FetchResults(Connection& connection, const FetchFlags& flags) {
  v1::Job job, base;
  if (const Status status = connection.GetJob(FullJobName(flags.job), &job); !status.ok()) {
    return Complain("fetch", status);
  }
  if (!HasEnded(job.state())) {
    std::fprintf(stderr, "tessera fetch: %s is %s; wait for it with: tessera watch %s\n", job.name().c_str(),
                 JobStateWord(job.state()).c_str(), job.name().c_str());
    return kExitFailed;
  }
  if (job.artifacts_size() == 0) {
    std::fprintf(stderr, "tessera fetch: %s %s and has published nothing\n", job.name().c_str(),
                 JobStateWord(job.state()).c_str());
    return kExitFailed;
  }
  std::vector<TileFileChange> changes;
  if (!flags.changed_since.empty()) {
    if (const Status status = connection.GetJob(FullJobName(flags.changed_since), &base); !status.ok()) {
      return Complain("fetch", status);
    }
    auto found = LeaveOutUnchanged(base, &job);
    if (!found.ok()) return Complain("fetch", found.status());
    changes = *std::move(found);
  }
  const std::string out = std::filesystem::absolute(flags.out).lexically_normal().string();
  if (const Status status = EnsureFolder(out); !status.ok()) return Complain("fetch", status);
  const std::string changes_path = out + "/changed.json";
  if (!flags.changed_since.empty()) {
    // Of an earlier fetch; where there is one, all that it tells of has come.
    if (const Status status = RemoveTree(changes_path); !status.ok()) return Complain("fetch", status);
  }
  const auto written = FetchArtifacts(connection, job, out, out + "/.fetch", {});
  if (!written.ok()) return Complain("fetch", written.status());
  for (const std::string& path : *written) std::printf("%s\n", path.c_str());
  if (flags.changed_since.empty()) return kExitOk;
  if (const Status status = WriteFileAtomic(changes_path, ChangesJson(base, job, changes)); !status.ok()) {
    return Complain("fetch", status);
  }
  const auto changed =
      std::count_if(changes.begin(), changes.end(), [](const auto& change) { return change.changed(); });
  std::printf("%s\n%td of %zu tile meshes changed since %s\n", changes_path.c_str(), changed, changes.size(),
              base.name().c_str());
  return kExitOk;
}

int Fetch(const FetchFlags& flags) {
  const auto connection = Connection::Open(flags.coordinator);
  if (!connection.ok()) return Complain("fetch", connection.status());
  if (!flags.timeline.empty()) {
    const Status status = WriteTimeline(**connection, FullJobName(flags.job), SystemClock(), flags.timeline);
    if (!status.ok()) return Complain("fetch", status);
    std::printf("%s\n", flags.timeline.c_str());
  }
  return flags.out.empty() ? kExitOk : FetchResults(**connection, flags);
}

}  // namespace

void AddFetchCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<FetchFlags>();
  CLI::App* command = app.add_subcommand("fetch", "Bring a job's results into a folder");
  command->footer(
      "Every file is checked against its hash and appears only when all have come; a fetch that was interrupted goes "
      "on\n"
      "where it stopped.\n"
      "With --changed-since only the tiles' meshes whose bytes are not those of the other job come, and all that is "
      "JSON,\n"
      "but not mesh.ply; changed.json says of every tile's mesh what its SHA-256 was and is (null: there is none).\n"
      "Every job stays as it was published: fetch an earlier one for the city as of then.\n"
      "Examples:\n"
      "  tessera fetch jobs/7 --out result\n"
      "  tessera fetch jobs/7 --changed-since jobs/3 --out changed\n"
      "  tessera fetch jobs/7 --timeline timeline.json");
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "The job's name or number")->required();
  CLI::Option* const out = command->add_option("--out", flags->out, "Folder for mesh.ply, report.json and the like");
  command
      ->add_option("--changed-since", flags->changed_since,
                   "Another job of the coordinator, as a rule an earlier one: only tiles that differ from its")
      ->needs(out);
  command->add_option("--timeline", flags->timeline,
                      "File for who did what when, which ui.perfetto.dev and chrome://tracing show: a row a worker, a "
                      "slice an attempt; of jobs in any state");
  command->parse_complete_callback([flags] {
    if (flags->out.empty() && flags->timeline.empty()) throw CLI::ValidationError("--out or --timeline is needed");
  });
  command->callback([flags, exit_code] { *exit_code = Fetch(*flags); });
}

}  // namespace tessera
