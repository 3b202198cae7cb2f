// `tessera fetch`: brings a job's results.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "common/storage/files.h"
#include "server/client/artifacts.h"
#include "server/client/command_line.h"
#include "server/client/commands.h"
#include "server/client/connection.h"
#include "server/client/job_words.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

struct FetchFlags {
  std::string coordinator;
  std::string job;
  std::string out;
};

int Fetch(const FetchFlags& flags) {
  const auto connection = Connection::Open(flags.coordinator);
  if (!connection.ok()) return Complain("fetch", connection.status());
  v1::Job job;
  if (const Status status = (*connection)->GetJob(FullJobName(flags.job), &job); !status.ok()) {
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
  const std::string out = std::filesystem::absolute(flags.out).lexically_normal().string();
  if (const Status status = EnsureFolder(out); !status.ok()) return Complain("fetch", status);
  const auto written = FetchArtifacts(**connection, job, out, out + "/.fetch", {});
  if (!written.ok()) return Complain("fetch", written.status());
  for (const std::string& path : *written) std::printf("%s\n", path.c_str());
  return kExitOk;
}

}  // namespace

void AddFetchCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<FetchFlags>();
  CLI::App* command = app.add_subcommand("fetch", "Bring a job's results into a folder");
  command->footer(
      "Every file is checked against its hash and appears only when all have come; a fetch that was interrupted goes "
      "on\n"
      "where it stopped.\n"
      "Example: tessera fetch jobs/7 --out result");
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "The job's name or number")->required();
  command->add_option("--out", flags->out, "Folder for mesh.ply, report.json and the like")->required();
  command->callback([flags, exit_code] { *exit_code = Fetch(*flags); });
}

}  // namespace tessera
