// `tessera lineage`: shows which job refined each tile.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <cstdio>
#include <memory>

#include "common/base/printable.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/artifacts.h"
#include "server/client/base_job.h"
#include "server/client/connection.h"
#include "server/client/interrupt.h"
#include "server/client/job_text.h"
#include "server/client/lineage.h"
#include "server/client/local_cluster.h"
#include "server/display/lineage_text.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

struct LineageFlags {
  Endpoint coordinator;
  std::string job;
  int tile = -1;
  bool images = false, json = false;
};

// Reads blobs of a coordinator through a local blob store.
class Reader {
 public:
  Reader(Connection& connection, BlobStore& store) : connection_(connection), store_(store) {}

  StatusOr<std::string> Blob(const Digest& digest) {
    TESSERA_RETURN_IF_ERROR(connection_.blobs().Fetch(digest, store_, TaskControl()));
    return store_.Read(digest);
  }

  // Empty if the job has no artifact of this name.
  StatusOr<std::string> Artifact(const v1::Job& job, const std::string& name) {
    for (const v1::Artifact& artifact : job.artifacts()) {
      if (artifact.name() == name) return Blob({artifact.digest().sha256(), artifact.digest().size_bytes()});
    }
    return std::string();
  }

  StatusOr<LineageJob> Job(const std::string& name) {
    v1::Job job;
    TESSERA_RETURN_IF_ERROR(connection_.GetJob(name, &job));
    if (job.state() != v1::JOB_STATE_SUCCEEDED) {
      return absl::FailedPreconditionError(name + " is " + JobStateName(job.state()) +
                                           ", expected a job that succeeded: lineage describes results");
    }
    TESSERA_RETURN_IF_ERROR(TakeArtifacts(connection_, "", &job));
    TESSERA_ASSIGN_OR_RETURN(const std::string report, Artifact(job, "job.json"));
    TESSERA_ASSIGN_OR_RETURN(const std::string update, Artifact(job, kUpdateFile));
    TESSERA_ASSIGN_OR_RETURN(LineageJob parsed, ParseLineageJob(report, update));
    parsed.base = job.settings().update().base();  // job.json of earlier releases has no base
    parsed.finished_s = job.end_time().seconds();
    return parsed;
  }

 private:
  Connection& connection_;
  BlobStore& store_;
};

StatusOr<Lineage> ReadLineage(Connection& connection, const std::string& job, int only_tile) {
  TESSERA_ASSIGN_OR_RETURN(const TempFolder folder, TempFolder::Create("", "tessera-lineage-"));
  TESSERA_ASSIGN_OR_RETURN(const auto store, FolderBlobs::Open(folder.path()));
  Reader reader(connection, *store);
  std::vector<LineageJob> chain;
  for (std::string name = job; !name.empty(); name = chain.back().base) {
    TESSERA_ASSIGN_OR_RETURN(LineageJob next, reader.Job(name));
    chain.push_back(std::move(next));
  }
  TESSERA_ASSIGN_OR_RETURN(Lineage lineage, TraceTiles(std::move(chain)));
  TESSERA_RETURN_IF_ERROR(FillImages([&](const Digest& survey) { return reader.Blob(survey); }, only_tile, &lineage));
  return lineage;
}

StatusOr<Lineage> LineageOfRun(const LineageFlags& flags) {
  TESSERA_ASSIGN_OR_RETURN(const RunResult result, ResolveBaseJob(flags.job, ""));
  TESSERA_ASSIGN_OR_RETURN(const TempFolder state, TempFolder::Create("", "tessera-lineage-"));
  Lineage lineage;
  const auto read = [&](LocalCluster&, Connection& connection) -> Status {
    TESSERA_ASSIGN_OR_RETURN(lineage, ReadLineage(connection, result.job, flags.tile));
    return absl::OkStatus();
  };
  TESSERA_RETURN_IF_ERROR(WithLocalCluster({state.path(), result.data_dir, /*workers=*/0}, read));
  return lineage;
}

bool IsJobName(const std::string& given) {
  return given.starts_with("jobs/") ||
         std::all_of(given.begin(), given.end(), [](unsigned char c) { return std::isdigit(c) != 0; });
}

StatusOr<Lineage> FindLineage(const LineageFlags& flags) {
  if (!IsJobName(flags.job)) return LineageOfRun(flags);
  TESSERA_ASSIGN_OR_RETURN(const auto connection, Connection::Open(flags.coordinator));
  return ReadLineage(*connection, FullJobName(flags.job), flags.tile);
}

StatusOr<int> PrintLineage(const LineageFlags& flags) {
  InstallInterruptCounter();
  TESSERA_ASSIGN_OR_RETURN(const Lineage lineage, FindLineage(flags));
  TESSERA_ASSIGN_OR_RETURN(const std::string text, flags.json ? LineageJson(lineage, flags.tile)
                                                   : flags.tile >= 0
                                                       ? TileLineageText(lineage, flags.tile, flags.images)
                                                       : LineageTable(lineage));
  std::fputs(PrintableLines(text).c_str(), stdout);
  return kExitOk;
}

}  // namespace

void AddLineageCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<LineageFlags>();
  CLI::App* command = app.add_subcommand("lineage", "Show which job refined each tile, and from which images");
  command->footer(
      "An update keeps tiles without new or withdrawn images, byte for byte. One line per tile: the job that refined "
      "it,\n"
      "its finish time (UTC), method and algorithm version, the number of images per flight, and the SHA-256 of the\n"
      "tile's state. With --tile: the action of each job of the chain on this tile, and its reason.\n"
      "Exit code: 0 succeeded, 1 failed, 2 wrong arguments, 3 wrong input, 4 coordinator unavailable.\n"
      "Examples:\n"
      "  tessera lineage jobs/7\n"
      "  tessera lineage jobs/7 --tile 12 --images\n"
      "  tessera lineage out --json > lineage.json");
  AddCoordinatorOption(*command, &flags->coordinator);
  command
      ->add_option("JOB", flags->job,
                   "Name or number of a job of the coordinator, or the --out folder of a run (with its .tessera)")
      ->required();
  CLI::Option* const tile = command->add_option("--tile", flags->tile, "Show only this tile, with its history")
                                ->check(CLI::NonNegativeNumber);
  command->add_flag("--images", flags->images, "Also list the images that the tile was refined from")->needs(tile);
  command->add_flag("--json", flags->json, "Print JSON, with all image names");
  SetAction(command, exit_code, [flags] { return PrintLineage(*flags); });
}

}  // namespace tessera
