// Metrics, log and timeline of the real programs agree with job.json.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "tests/e2e/programs.h"
#include "tests/support/http_get.h"

namespace tessera::e2e {
namespace {

using nlohmann::json;
using testing::HasSubstr;

class ObservabilityTest : public testing::Test {
 protected:
  // Every sample by its name and labels as they are written.
  std::map<std::string, double> Samples() {
    const std::string page = HttpGet(metrics_, "/metrics");
    std::istringstream text(page.substr(page.find("\r\n\r\n") + 4));
    std::map<std::string, double> samples;
    for (std::string line; std::getline(text, line);) {
      const size_t space = line.rfind(' ');
      if (line.rfind('#', 0) != 0 && space != std::string::npos)
        samples[line.substr(0, space)] = std::stod(line.substr(space));
    }
    return samples;
  }
  void FindMetrics(Cluster& cluster) {
    const std::string said = cluster.coordinator().Output(), before = "metrics: http://";
    const size_t begin = said.find(before);
    ASSERT_NE(begin, std::string::npos) << said;
    metrics_ = said.substr(begin + before.size(), said.find("/metrics\n", begin) - begin - before.size());
  }
  const TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
  std::string metrics_;
};

TEST_F(ObservabilityTest, MetricsAndTimelineMatchJobReport) {
  Cluster cluster(folder_.path(), 3, {"--metrics-listen", "127.0.0.1:0", "--no-shared-storage", "--json-logs"});
  FindMetrics(cluster);
  const std::string hostile = "city\n{\"message\":\"audit\"}\x1b[2J<img src=x onerror=alert(1)>";
  const Outcome submitted = Tessera(
      folder_.path(), {"submit", ToyCity(), "--tiles", "4", "--name", hostile, "--coordinator", cluster.address()});
  ASSERT_EQ(submitted.output, "jobs/1\n");
  Program& killed = cluster.AddWorker();
  v1::ListWorkersResponse workers;
  ASSERT_TRUE(
      WaitUntil([&] { return cluster.connection().ListWorkers(&workers).ok() && workers.workers_size() == 1; }));
  const std::string name = workers.workers(0).name();
  cluster.AddWorker();
  // It dies at work, so that an attempt is lost.
  const auto is_at_work = [&] {
    const std::vector<v1::Task> tasks = cluster.Tasks("jobs/1");
    return std::any_of(tasks.begin(), tasks.end(), [&](const v1::Task& task) {
      return task.kind() != "ingest" && task.state() == v1::TASK_STATE_LEASED && task.worker() == name;
    });
  };
  ASSERT_TRUE(WaitUntil([&] {
    if (!is_at_work()) return false;
    killed.Signal(SIGSTOP);
    if (is_at_work()) return true;
    killed.Signal(SIGCONT);
    return false;
  }));
  killed.Kill();
  const v1::Job job = cluster.Await("jobs/1");
  ASSERT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.error();
  const std::string out = cluster.Fetch(job.name());
  const json told = json::parse(Content(out + "/job.json"));
  const std::string page = Content(out + "/report.html");
  EXPECT_THAT(page, HasSubstr("\\x1b[2J&lt;img src=x onerror=alert(1)&gt;")) << "the job's name is text";
  EXPECT_THAT(page, Not(HasSubstr("<img src=x")));
  const std::map<std::string, double> samples = Samples();
  const auto sample = [&](const std::string& name) {
    const auto found = samples.find(name);
    return found == samples.end() ? std::nan("") : found->second;
  };
  const auto of_kind = [&](const std::string& name, const std::string& kind) {
    return sample("tessera_" + name + "{kind=\"" + kind + "\"}");
  };

  struct Sums {
    int64_t succeeded = 0, attempts = 0, failed = 0, bytes = 0;
    double core_s = 0, predicted_s = 0;
  };
  std::map<std::string, Sums> of_kinds;
  int64_t failed = 0;
  for (const json& task : told["tasks"]) {
    Sums& sums = of_kinds[task["kind"]];
    sums.attempts += task["attempts"].get<int64_t>();
    for (const json& run : task["runs"]) failed += run.contains("error_class") ? 1 : 0;
    if (task["state"] != "succeeded" || task["reused"] == true) continue;
    ++sums.succeeded;
    for (const auto& output : task["outputs"]) sums.bytes += output["size_bytes"].get<int64_t>();
    sums.core_s += task["used"]["core_seconds"].get<double>();
    sums.predicted_s += task["predicted"]["core_seconds"].get<double>();
  }
  ASSERT_GE(of_kinds.size(), 5u);
  int64_t attempts = 0, succeeded = 0;
  for (const auto& [kind, sums] : of_kinds) {
    EXPECT_EQ(of_kind("tasks_succeeded_total", kind), sums.succeeded) << kind;
    EXPECT_EQ(of_kind("attempts_started_total", kind), sums.attempts) << kind;
    EXPECT_EQ(of_kind("task_output_bytes_total", kind), sums.bytes) << kind;
    EXPECT_NEAR(of_kind("task_core_seconds_total", kind), sums.core_s, 1e-6 * (1 + sums.core_s)) << kind;
    EXPECT_NEAR(of_kind("task_predicted_core_seconds_total", kind), sums.predicted_s, 1e-6 * (1 + sums.predicted_s));
    attempts += sums.attempts;
    succeeded += sums.succeeded;
  }
  double failures = 0;
  for (const auto& [name, value] : samples) {
    if (name.rfind("tessera_attempts_failed_total", 0) == 0) failures += value;
  }
  EXPECT_EQ(failures, failed);
  EXPECT_GE(failed, 1) << "of the worker that was killed";
  EXPECT_EQ(attempts, told["totals"]["attempts"].get<int64_t>());
  EXPECT_EQ(sample("tessera_jobs_ended_total{state=\"succeeded\"}"), 1);
  EXPECT_EQ(sample("tessera_jobs{state=\"running\"}"), 0);
  EXPECT_EQ(sample("tessera_tasks_unfinished"), 0);
  EXPECT_EQ(sample("tessera_storage_ok"), 1);
  EXPECT_EQ(sample("tessera_journal_records_total"), sample("tessera_journal_batch_records_sum"));
  EXPECT_GT(sample("tessera_journal_syncs_total"), 0);
  EXPECT_GT(sample("tessera_disk_free_bytes"), 0);
  EXPECT_EQ(sample("tessera_rpcs_total{method=\"Workers/ReportTask\",code=\"OK\"}"), succeeded);
  // All results came through the blob service, those of equal content once.
  std::map<std::string, int64_t> written;
  for (const json& task : told["tasks"]) {
    for (const auto& output : task["outputs"]) written[output["sha256"]] = output["size_bytes"];
  }
  int64_t written_bytes = 0;
  for (const auto& [sha256, bytes] : written) written_bytes += bytes;
  EXPECT_GE(sample("tessera_blob_bytes_total{direction=\"written\"}"), written_bytes);
  EXPECT_GT(sample("tessera_blob_bytes_total{direction=\"read\"}"), 0);

  // Every attempt once, none beside another in its row.
  const std::string path = folder_.path() + "/timeline.json";
  const Outcome fetched =
      Tessera(folder_.path(), {"fetch", "1", "--timeline", path, "--coordinator", cluster.address()});
  ASSERT_EQ(fetched.exit_code, 0) << fetched.output;
  const json trace = json::parse(Content(path));
  EXPECT_EQ(trace["otherData"]["name"], hostile);
  std::map<std::string, std::set<int>> drawn;
  std::map<std::pair<int, int>, std::map<int64_t, int64_t>> rows;  // ends by starts
  int64_t failures_drawn = 0;
  for (const json& event : trace["traceEvents"]) {
    if (event["ph"] != "X") continue;
    EXPECT_TRUE(drawn[event["args"]["task"]].insert(event["args"]["attempt"].get<int>()).second);
    failures_drawn += event["cat"].get<std::string>().find(",failed") != std::string::npos ? 1 : 0;
    const int64_t start = event["ts"], end = start + event["dur"].get<int64_t>();
    auto& row = rows[{event["pid"], event["tid"]}];
    for (const auto& [other_start, other_end] : row) EXPECT_TRUE(end <= other_start || other_end <= start);
    row[start] = end;
  }
  int64_t total = 0;
  for (const auto& [task, numbers] : drawn) total += static_cast<int64_t>(numbers.size());
  EXPECT_EQ(total, attempts);
  EXPECT_EQ(failures_drawn, failed);
  EXPECT_EQ(rows.size(), 2u);

  // The log: an object a line, whatever the job is called.
  std::istringstream log(cluster.coordinator().Output());
  std::set<std::string> actions;
  for (std::string line; std::getline(log, line);) {
    if (line.rfind('{', 0) != 0) continue;
    const json object = json::parse(line, nullptr, /*allow_exceptions=*/false);
    ASSERT_TRUE(object.is_object() && object.contains("time") && object.contains("level")) << line;
    if (object["message"] == "audit") actions.insert(object["action"].get<std::string>());
    if (object["message"] == "task leased") {
      for (const char* field : {"job", "task", "attempt", "worker", "kind"})
        EXPECT_TRUE(object.contains(field)) << line;
    }
  }
  EXPECT_THAT(actions, testing::IsSupersetOf({"CreateJob", "RegisterWorker", "WriteBlob"}));
  const Outcome jobs = Tessera(folder_.path(), {"jobs", "--coordinator", cluster.address()});
  EXPECT_THAT(jobs.output, HasSubstr("city\\n{\"message\":\"audit\"}\\x1b[2J"));
}

TEST_F(ObservabilityTest, RunWritesItsTimeline) {
  const std::string path = folder_.path() + "/timeline.json", out = folder_.path() + "/out";
  const Outcome run = Tessera(folder_.path(), {"run", ToyCity(), "--tiles", "1", "--out", out, "--timeline", path});
  ASSERT_EQ(run.exit_code, 0) << run.output;
  int64_t slices = 0;
  const json trace = json::parse(Content(path));
  for (const json& event : trace["traceEvents"]) slices += event["ph"] == "X" ? 1 : 0;
  EXPECT_EQ(slices, json::parse(Content(out + "/job.json"))["totals"]["attempts"].get<int64_t>());
}

TEST_F(ObservabilityTest, OccupiedMetricsPortIsReported) {
  Cluster cluster(folder_.path(), 3, {"--metrics-listen", "127.0.0.1:0"});
  FindMetrics(cluster);
  const Outcome second =
      Program(folder_.path(), TESSERAD_PROGRAM,
              {"--data", folder_.path() + "/other", "--listen", "127.0.0.1:0", "--metrics-listen", metrics_})
          .Wait();
  EXPECT_EQ(second.exit_code, 1);
  EXPECT_THAT(second.output, HasSubstr("cannot listen on " + metrics_ + " for metrics"));
}

}  // namespace
}  // namespace tessera::e2e
