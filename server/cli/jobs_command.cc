// `tessera jobs`: lists jobs and workers of a coordinator.
#include <google/protobuf/util/json_util.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

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

// Columns as wide as their widest entry.
void PrintTable(std::vector<Row> rows) {
  for (Row& row : rows) {
    for (std::string& entry : row) entry = Printable(entry);
  }
  std::vector<size_t> widths(rows.front().size());
  for (const Row& row : rows) {
    for (size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  for (const Row& row : rows) {
    std::string line;
    for (size_t i = 0; i < row.size(); ++i) line += row[i] + std::string(widths[i] - row[i].size() + 2, ' ');
    line.erase(line.find_last_not_of(' ') + 1);
    std::printf("%s\n", line.c_str());
  }
}

// Adds one row per line of the text; the first row has the name.
void AddText(const std::string& name, std::string_view text, std::vector<Row>* rows) {
  for (bool first = true; first || !text.empty(); first = false) {
    const size_t end = std::min(text.find('\n'), text.size());
    rows->push_back({first ? name : "", std::string(text.substr(0, end))});
    text.remove_prefix(std::min(end + 1, text.size()));
  }
}

std::string LocalTimeText(int64_t unix_s) {
  if (unix_s <= 0) return "-";
  const time_t time = unix_s;
  tm local = {};
  localtime_r(&time, &local);
  char text[32];
  std::strftime(text, sizeof(text), "%Y-%m-%d %H:%M", &local);
  return text;
}

int PrintJson(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  options.always_print_primitive_fields = true;
  options.add_whitespace = true;
  std::string text;
  const auto status = google::protobuf::util::MessageToJsonString(message, &text, options);
  if (!status.ok()) {
    std::fprintf(stderr, "tessera jobs: %s\n", status.ToString().c_str());
    return kExitFailed;
  }
  std::printf("%s", text.c_str());
  return kExitOk;
}

int Workers(Connection& connection, bool json) {
  v1::ListWorkersResponse workers;
  if (const Status status = connection.ListWorkers(&workers); !status.ok()) return ReportError("jobs", status);
  if (json) return PrintJson(workers);
  std::vector<Row> rows = {{"WORKER", "HOST", "PID", "THREADS", "MEMORY", "SEEN", "TASKS"}};
  for (const v1::Worker& worker : workers.workers()) {
    std::string tasks;
    for (const std::string& task : worker.tasks()) tasks += (tasks.empty() ? "" : ", ") + task;
    char memory[32];
    std::snprintf(memory, sizeof(memory), "%.1f GiB", static_cast<double>(worker.memory_bytes()) / (1 << 30));
    if (!worker.suspended_reason().empty()) {
      tasks = "suspended for " + FormatDuration(worker.suspended_s()) + ": " + worker.suspended_reason();
    }
    rows.push_back({worker.name(), worker.host(), std::to_string(worker.pid()), std::to_string(worker.threads()),
                    memory, FormatDuration(worker.last_seen_s()) + " ago", tasks.empty() ? "-" : tasks});
  }
  PrintTable(std::move(rows));
  return kExitOk;
}

// Prints one job and, if it waits, the reason.
int OneJob(Connection& connection, const JobsFlags& flags) {
  v1::Job job;
  if (const Status status = connection.GetJob(FullJobName(flags.job), &job); !status.ok()) {
    return ReportError("jobs", status);
  }
  if (flags.json) return PrintJson(job);
  std::vector<Row> rows = {{"job", job.name()}, {"name", job.display_name()}, {"scene", job.scene_path()}};
  rows.push_back({"state", JobStatusName(job)});
  if (!job.waiting_for().empty()) AddText("reason", job.waiting_for(), &rows);
  rows.push_back({"priority", std::to_string(job.priority())});
  rows.push_back({"submitted", LocalTimeText(job.create_time().seconds())});
  rows.push_back({"done", std::to_string(static_cast<int>(100 * job.progress())) + "%, " +
                              std::to_string(job.tiles_done()) + " of " + std::to_string(job.tiles_total()) +
                              " tiles, " + std::to_string(job.tasks_done()) + " of " +
                              std::to_string(job.tasks_total()) + " tasks"});
  if (!HasEnded(job.state()) && job.eta_s() >= 0) rows.push_back({"to go", FormatDuration(job.eta_s())});
  if (!job.error().empty()) AddText("error", job.error(), &rows);
  for (const std::string& warning : job.warnings()) AddText("warning", warning, &rows);
  PrintTable(std::move(rows));
  return kExitOk;
}

int Jobs(const JobsFlags& flags) {
  const auto connection = Connection::Open(flags.coordinator);
  if (!connection.ok()) return ReportError("jobs", connection.status());
  if (flags.workers) return Workers(**connection, flags.json);
  if (!flags.job.empty()) return OneJob(**connection, flags);
  v1::ListJobsResponse jobs;
  if (const Status status = (*connection)->ListJobs(flags.count, &jobs); !status.ok())
    return ReportError("jobs", status);
  if (flags.json) return PrintJson(jobs);
  std::vector<Row> rows = {{"JOB", "STATE", "PRIORITY", "TILES", "DONE", "TO GO", "SUBMITTED", "NAME"}};
  for (const v1::Job& job : jobs.jobs()) {
    const bool ended = HasEnded(job.state());
    rows.push_back({job.name(), JobStatusName(job), std::to_string(job.priority()),
                    std::to_string(job.tiles_done()) + "/" + std::to_string(job.tiles_total()),
                    std::to_string(static_cast<int>(100 * job.progress())) + "%",
                    ended || job.eta_s() < 0 ? "-" : FormatDuration(job.eta_s()),
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
  command->callback([flags, exit_code] { *exit_code = Jobs(*flags); });
}

}  // namespace tessera
