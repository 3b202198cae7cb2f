// `tessera jobs`: lists jobs and workers of a coordinator.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "absl/time/time.h"
#include "common/base/printable.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/connection.h"
#include "server/client/job_text.h"
#include "tessera/v1/jobs.pb.h"
#include "tessera/v1/workers.pb.h"

namespace tessera {
namespace {

struct JobsFlags {
  Endpoint coordinator;
  std::string job;
  int count = 100;
  bool workers = false;
  bool json = false;
};

using Row = std::vector<std::string>;

void PrintTable(std::vector<Row> rows) {
  for (Row& row : rows) {
    for (std::string& entry : row) entry = Printable(entry);
  }
  std::printf("%s", ColumnsText(rows).c_str());
}

// Adds one row per line of the text; the first row has the name.
void AddText(const std::string& name, const std::string& text, std::vector<Row>* rows) {
  const std::vector<std::string> lines = absl::StrSplit(absl::StripSuffix(text, "\n"), '\n');
  for (size_t i = 0; i < lines.size(); ++i) rows->push_back({i == 0 ? name : "", lines[i]});
}

std::string LocalTimeText(int64_t unix_s) {
  if (unix_s <= 0) return "-";
  return absl::FormatTime("%Y-%m-%d %H:%M", absl::FromUnixSeconds(unix_s), absl::LocalTimeZone());
}

StatusOr<int> PrintJson(const google::protobuf::Message& message) {
  TESSERA_ASSIGN_OR_RETURN(const std::string text, ProtoJson(message, /*indented=*/true));
  std::printf("%s", text.c_str());
  return kExitOk;
}

StatusOr<int> Workers(Connection& connection, bool json) {
  v1::ListWorkersResponse workers;
  TESSERA_RETURN_IF_ERROR(connection.ListWorkers(&workers));
  if (json) return PrintJson(workers);
  std::vector<Row> rows = {{"WORKER", "HOST", "PID", "THREADS", "MEMORY", "SEEN", "TASKS"}};
  for (const v1::Worker& worker : workers.workers()) {
    std::string tasks = absl::StrJoin(worker.tasks(), ", ");
    if (!worker.suspended_reason().empty()) {
      tasks = "suspended for " + FormatDuration(worker.suspended_s()) + ": " + worker.suspended_reason();
    }
    rows.push_back({worker.name(), worker.host(), absl::StrCat(worker.pid()), absl::StrCat(worker.threads()),
                    absl::StrFormat("%.1f GiB", static_cast<double>(worker.memory_bytes()) / (1 << 30)),
                    FormatDuration(worker.last_seen_s()) + " ago", tasks.empty() ? "-" : tasks});
  }
  PrintTable(std::move(rows));
  return kExitOk;
}

std::string PercentText(const v1::Job& job) { return absl::StrCat(static_cast<int>(100 * job.progress()), "%"); }

// Prints one job and, if it waits, the reason.
StatusOr<int> OneJob(Connection& connection, const JobsFlags& flags) {
  v1::Job job;
  TESSERA_RETURN_IF_ERROR(connection.GetJob(FullJobName(flags.job), &job));
  if (flags.json) return PrintJson(job);
  std::vector<Row> rows = {{"job", job.name()}, {"name", job.display_name()}, {"scene", job.scene_path()}};
  rows.push_back({"state", JobStatusName(job)});
  if (!job.waiting_for().empty()) AddText("reason", job.waiting_for(), &rows);
  rows.push_back({"priority", absl::StrCat(job.priority())});
  rows.push_back({"submitted", LocalTimeText(job.create_time().seconds())});
  rows.push_back({"done", absl::StrCat(PercentText(job), ", ", job.tiles_done(), " of ", job.tiles_total(), " tiles, ",
                                       job.tasks_done(), " of ", job.tasks_total(), " tasks")});
  if (!HasEnded(job.state()) && job.eta_s() >= 0) rows.push_back({"to go", FormatDuration(job.eta_s())});
  if (!job.error().empty()) AddText("error", job.error(), &rows);
  for (const std::string& warning : job.warnings()) AddText("warning", warning, &rows);
  PrintTable(std::move(rows));
  return kExitOk;
}

StatusOr<int> Jobs(const JobsFlags& flags) {
  TESSERA_ASSIGN_OR_RETURN(const auto connection, Connection::Open(flags.coordinator));
  if (flags.workers) return Workers(*connection, flags.json);
  if (!flags.job.empty()) return OneJob(*connection, flags);
  v1::ListJobsResponse jobs;
  TESSERA_RETURN_IF_ERROR(connection->ListJobs(flags.count, &jobs));
  if (flags.json) return PrintJson(jobs);
  std::vector<Row> rows = {{"JOB", "STATE", "PRIORITY", "TILES", "DONE", "TO GO", "SUBMITTED", "NAME"}};
  for (const v1::Job& job : jobs.jobs()) {
    rows.push_back({job.name(), JobStatusName(job), absl::StrCat(job.priority()),
                    absl::StrCat(job.tiles_done(), "/", job.tiles_total()), PercentText(job),
                    HasEnded(job.state()) || job.eta_s() < 0 ? "-" : FormatDuration(job.eta_s()),
                    LocalTimeText(job.create_time().seconds()), job.display_name()});
  }
  PrintTable(std::move(rows));
  return kExitOk;
}

}  // namespace

void AddJobsCommand(CLI::App& app, int* exit_code) {
  auto flags = std::make_shared<JobsFlags>();
  CLI::App* command = app.add_subcommand("jobs", "List jobs or workers of a coordinator");
  command->footer(
      "Lists the newest jobs first. With JOB: its state, progress, errors and, if it waits, the reason.\n"
      "Examples:\n"
      "  tessera jobs\n"
      "  tessera jobs jobs/7\n"
      "  tessera jobs --workers\n"
      "  tessera jobs --json --count 1000");
  AddCoordinatorOption(*command, &flags->coordinator);
  command->add_option("JOB", flags->job, "Show only this job, by name or number");
  command->add_option("--count", flags->count, "Largest number of jobs to list")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  command->add_flag("--workers", flags->workers, "List workers and their running tasks");
  command->add_flag("--json", flags->json, "Print JSON");
  SetAction(command, exit_code, [flags] { return Jobs(*flags); });
}

}  // namespace tessera
