// Metrics of a coordinator after a known sequence of steps.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <prometheus/metric_family.h>
#include <prometheus/text_serializer.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>
#include <utility>

#include "server/metrics/metric_families.h"
#include "server/metrics/metrics_server.h"
#include "tests/support/fake_coordinator.h"
#include "tests/support/http_get.h"

namespace tessera {
namespace {

using testing::HasSubstr;
using testing::Not;

class MetricsTest : public CoordinatorTest {
 protected:
  MetricsTest() {
    sources_.dispatch = [this] { return SnapshotOf(coordinator_->core()); };
    sources_.free_bytes = [] { return std::optional<int64_t>(123456789); };
    sources_.rpcs = &rpcs_;
  }
  std::string Text() const { return prometheus::TextSerializer().Serialize(Families(sources_)); }
  // The value of the sample written so, labels included; NaN if there is none.
  double Value(const std::string& sample) const {
    std::istringstream text(Text());
    for (std::string line; std::getline(text, line);) {
      if (line.rfind(sample + " ", 0) == 0) return std::stod(line.substr(sample.size() + 1));
    }
    return std::nan("");
  }

  RpcCounts rpcs_{{"/tessera.v1.Jobs/CreateJob", "/tessera.v1.Blobs/ReadBlob"}};
  MetricSources sources_;
};

TEST_F(MetricsTest, MetricsSumTaskResults) {
  const std::string job = Create(AJob(2));
  const std::string worker = Worker(), other = Worker("other/boot");
  clock_.Advance(3);
  const auto ingest = Lease(worker);
  EXPECT_EQ(Value("tessera_leases{kind=\"ingest\"}"), 1);
  EXPECT_EQ(Value("tessera_workers{state=\"working\"}"), 1);
  EXPECT_EQ(Value("tessera_workers{state=\"idle\"}"), 1);
  EXPECT_EQ(Value("tessera_jobs{state=\"running\"}"), 1);
  clock_.Advance(4);
  ASSERT_TRUE(Succeed(worker, *ingest).ok());  // 7.5 core-seconds where 1 was predicted
  const auto refine = Lease(worker);
  ASSERT_TRUE(Fail(worker, *refine, ErrorClass::kScratch).ok());
  EXPECT_EQ(Value("tessera_workers{state=\"suspended\"}"), 1);
  EXPECT_EQ(Value("tessera_workers_suspended_total"), 1);
  EXPECT_EQ(Value("tessera_tasks_ready{kind=\"refine\",memory=\"unknown\"}"), 2);
  const auto broken = Lease(other);
  ASSERT_TRUE(Fail(other, *broken, ErrorClass::kInternal).ok());
  EXPECT_EQ(Value("tessera_tasks_ready{kind=\"refine\",memory=\"unknown\"}"), 1);
  EXPECT_EQ(Value("tessera_tasks_delayed"), 1);
  clock_.Advance(60);
  EXPECT_EQ(Value("tessera_oldest_ready_task_age_seconds"), 60);
  EXPECT_EQ(Value("tessera_workers{state=\"silent\"}"), 2);
  EXPECT_EQ(Value("tessera_workers{state=\"idle\"}"), 0);
  ASSERT_TRUE(Lease(other));
  clock_.Advance(31);
  ASSERT_TRUE(coordinator_->Tick().ok());  // its lease expires
  clock_.Advance(100);
  EXPECT_GT(WorkAll(Worker()), 0);
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);

  EXPECT_EQ(Value("tessera_attempts_started_total{kind=\"ingest\"}"), 1);
  EXPECT_EQ(Value("tessera_attempts_started_total{kind=\"refine\"}"), 5);
  EXPECT_EQ(Value("tessera_attempts_failed_total{class=\"scratch\"}"), 1);
  EXPECT_EQ(Value("tessera_attempts_failed_total{class=\"internal\"}"), 1);
  EXPECT_EQ(Value("tessera_attempts_failed_total{class=\"lease_expired\"}"), 1);
  EXPECT_EQ(Value("tessera_attempts_failed_total{class=\"transient\"}"), 0) << "counted once";
  EXPECT_EQ(Value("tessera_tasks_succeeded_total{kind=\"refine\"}"), 2);
  EXPECT_EQ(Value("tessera_tasks_succeeded_total{kind=\"publish\"}"), 1);
  EXPECT_EQ(Value("tessera_attempt_seconds_total{kind=\"ingest\"}"), 4);
  EXPECT_EQ(Value("tessera_task_core_seconds_total{kind=\"refine\"}"), 15);
  EXPECT_EQ(Value("tessera_task_predicted_core_seconds_total{kind=\"refine\"}"), 1 + 2);
  EXPECT_EQ(Value("tessera_task_core_seconds_ratio_count{kind=\"refine\"}"), 2);
  EXPECT_EQ(Value("tessera_task_core_seconds_ratio_bucket{kind=\"refine\",le=\"4\"}"), 1) << "7.5 / 2";
  EXPECT_EQ(Value("tessera_task_core_seconds_ratio_bucket{kind=\"refine\",le=\"10\"}"), 2) << "7.5 / 1";
  EXPECT_EQ(Value("tessera_task_memory_ratio_count{kind=\"refine\"}"), 0) << "no memory was predicted";
  EXPECT_EQ(Value("tessera_task_output_bytes_total{kind=\"publish\"}"),
            static_cast<double>(Task(job, 3).task.outputs.at(0).size_bytes));
  EXPECT_EQ(Value("tessera_jobs_accepted_total"), 1);
  EXPECT_EQ(Value("tessera_jobs_ended_total{state=\"succeeded\"}"), 1);
  EXPECT_EQ(Value("tessera_jobs{state=\"running\"}"), 0);
  EXPECT_EQ(Value("tessera_tasks_unfinished"), 0);
  EXPECT_EQ(Value("tessera_oldest_ready_task_age_seconds"), 0);
  EXPECT_EQ(Value("tessera_disk_free_bytes"), 123456789);

  // The same scene again: all is found.
  Create(AJob(2));
  EXPECT_EQ(Value("tessera_tasks_reused_total{kind=\"refine\"}"), 2);
  EXPECT_EQ(Value("tessera_tasks_succeeded_total{kind=\"refine\"}"), 2);
}

TEST_F(MetricsTest, QueueMetricsCountLeasableTasksOnly) {
  const std::string job = Create(AJob(3));
  EXPECT_EQ(Value("tessera_tasks_ready{kind=\"ingest\",memory=\"unknown\"}"), 1);
  EXPECT_EQ(Value("tessera_jobs{state=\"queued\"}"), 1);
  clock_.Advance(7);
  EXPECT_EQ(Value("tessera_oldest_ready_task_age_seconds"), 7);
  ASSERT_TRUE(coordinator_->jobs().ChangeJob(job, {{}, true}).ok());
  EXPECT_EQ(Value("tessera_tasks_ready{kind=\"ingest\",memory=\"unknown\"}"), 0);
  EXPECT_EQ(Value("tessera_oldest_ready_task_age_seconds"), 0);
  EXPECT_EQ(Value("tessera_jobs{state=\"paused\"}"), 1);
  ASSERT_TRUE(coordinator_->jobs().ChangeJob(job, {{}, false}).ok());
  EXPECT_EQ(Value("tessera_tasks_ready{kind=\"ingest\",memory=\"unknown\"}"), 1);
  // What was ready before a restart has waited since then.
  ASSERT_TRUE(coordinator_->core().Durable().ok());
  Restart();
  EXPECT_EQ(Value("tessera_oldest_ready_task_age_seconds"), 7);
}

TEST_F(MetricsTest, MetricsCoverTheJournal) {
  options_.durable_wait_s = 0.05;
  Restart();
  Create(AJob(1));
  EXPECT_EQ(Value("tessera_storage_ok"), 1);
  EXPECT_GE(Value("tessera_journal_batches_total"), 1);
  EXPECT_EQ(Value("tessera_journal_records_total"), 2) << "accepted, planned";
  EXPECT_EQ(Value("tessera_journal_records_total"), Value("tessera_journal_batch_records_sum"));
  EXPECT_EQ(Value("tessera_journal_batches_total"), Value("tessera_journal_batch_seconds_count"));
  store_.fail = true;
  EXPECT_FALSE(coordinator_->jobs().CreateJob(AJob(1, "other")).ok());
  EXPECT_EQ(Value("tessera_storage_ok"), 0);
  EXPECT_GE(Value("tessera_journal_failures_total"), 1);
  EXPECT_EQ(Value("tessera_journal_waiting_records"), 1);
  store_.fail = false;
  while (!coordinator_->core().Durable().ok()) {  // the journal tries again after a while
  }
  EXPECT_EQ(Value("tessera_storage_ok"), 1);
}

TEST_F(MetricsTest, MetricsCountCallsByMethodAndCode) {
  RpcCounts::Count(rpcs_.Of("/tessera.v1.Jobs/CreateJob"), 0, 0.002);
  RpcCounts::Count(rpcs_.Of("/tessera.v1.Jobs/CreateJob"), 3, 0.2);
  RpcCounts::Count(rpcs_.Of("/whatever/a.caller/sends"), 12, 5);
  RpcCounts::Count(rpcs_.Of("/tessera.v1.Jobs/CreateJob"), 99, 100);
  rpcs_.CountBlobBytes(5, 7);
  EXPECT_EQ(Value("tessera_rpcs_total{method=\"Jobs/CreateJob\",code=\"OK\"}"), 1);
  EXPECT_EQ(Value("tessera_rpcs_total{method=\"Jobs/CreateJob\",code=\"INVALID_ARGUMENT\"}"), 1);
  EXPECT_EQ(Value("tessera_rpcs_total{method=\"Jobs/CreateJob\",code=\"other\"}"), 1);
  EXPECT_EQ(Value("tessera_rpcs_total{method=\"other\",code=\"UNIMPLEMENTED\"}"), 1);
  EXPECT_EQ(Value("tessera_rpcs_total{method=\"Blobs/ReadBlob\",code=\"OK\"}"), 0);
  EXPECT_EQ(Value("tessera_rpc_seconds_bucket{method=\"Jobs/CreateJob\",le=\"0.003\"}"), 1);
  EXPECT_EQ(Value("tessera_rpc_seconds_bucket{method=\"Jobs/CreateJob\",le=\"10\"}"), 2);
  EXPECT_EQ(Value("tessera_rpc_seconds_count{method=\"Jobs/CreateJob\"}"), 3);
  EXPECT_EQ(Value("tessera_blob_bytes_total{direction=\"read\"}"), 5);
  EXPECT_EQ(Value("tessera_blob_bytes_total{direction=\"written\"}"), 7);
}

TEST_F(MetricsTest, MetricsCountRequestsByRouteAndClassOfStatus) {
  EXPECT_TRUE(std::isnan(Value("tessera_http_requests_total{route=\"GET /a/{job}\",status=\"2xx\"}")));  // no page
  HttpCounts counts({"GET /a/{job}", "POST /b"});
  sources_.http = &counts;
  counts.Count(0, 200, 0.002);
  counts.Count(0, 304, 0.2);
  counts.Count(2, 404, 100);
  counts.Count(77, 9999, 0);
  EXPECT_EQ(Value("tessera_http_requests_total{route=\"GET /a/{job}\",status=\"2xx\"}"), 1);
  EXPECT_EQ(Value("tessera_http_requests_total{route=\"GET /a/{job}\",status=\"3xx\"}"), 1);
  EXPECT_EQ(Value("tessera_http_requests_total{route=\"POST /b\",status=\"2xx\"}"), 0);
  EXPECT_EQ(Value("tessera_http_requests_total{route=\"other\",status=\"4xx\"}"), 1);
  EXPECT_EQ(Value("tessera_http_requests_total{route=\"other\",status=\"5xx\"}"), 1);
  EXPECT_EQ(Value("tessera_http_request_seconds_bucket{route=\"GET /a/{job}\",le=\"0.003\"}"), 1);
  EXPECT_EQ(Value("tessera_http_request_seconds_count{route=\"GET /a/{job}\"}"), 2);
  sources_.http = nullptr;
}

// Labels hold no name of a user, worker or scene, and the number of samples does not grow with jobs or workers.
TEST_F(MetricsTest, MetricLabelsHoldNoUserNames) {
  const auto lines = [&] {
    const std::string text = Text();
    return std::count(text.begin(), text.end(), '\n');
  };
  const auto before = lines();
  for (int i = 0; i < 30; ++i) {
    NewJob job = AJob(2, "scene" + std::to_string(i));
    job.display_name = "secret name";
    job.scene_path = "/secret/path";
    job.request = {"secret request " + std::to_string(i), "/secret/path", job.settings};
    Create(job);
    ASSERT_TRUE(coordinator_->leases().RegisterWorker({"secret-host", 1, 2, 1000, 0, "secret-host/boot"}).ok());
  }
  const std::string worker = Worker();
  ASSERT_TRUE(Fail(worker, *Lease(worker), ErrorClass::kInternal).ok());
  WorkAll(worker);
  EXPECT_THAT(Text(), Not(HasSubstr("secret")));
  EXPECT_THAT(Text(), Not(HasSubstr("jobs/")));
  EXPECT_THAT(Text(), Not(HasSubstr("workers/")));
  EXPECT_EQ(lines(), before);
}

TEST_F(MetricsTest, MetricsAreServedOverHttp) {
  const auto server = MetricsServer::Start("127.0.0.1:0", sources_);
  ASSERT_TRUE(server.ok()) << server.status();
  const std::string answer = HttpGet((*server)->address(), "/metrics");
  EXPECT_THAT(answer, HasSubstr("200 OK"));
  EXPECT_THAT(answer, HasSubstr("\ntessera_tasks_unfinished 0\n"));
  EXPECT_THAT(HttpGet((*server)->address(), "/other"), HasSubstr("404"));
  EXPECT_EQ(MetricsServer::Start((*server)->address(), sources_).status().code(), absl::StatusCode::kUnavailable);
  for (const char* wrong : {"", "9464", ":9464", "127.0.0.1:", "127.0.0.1:x", "127.0.0.1:70000", "127.0.0.1:1,2:3"}) {
    EXPECT_EQ(MetricsServer::Start(wrong, sources_).status().code(), absl::StatusCode::kInvalidArgument) << wrong;
  }
}

TEST_F(MetricsTest, StandbyServesItsRoleUntilItIsActive) {
  const auto server = *MetricsServer::Start("127.0.0.1:0", {});
  const std::string standby = HttpGet(server->address(), "/metrics");
  EXPECT_THAT(standby, HasSubstr("tessera_coordinator_active 0"));
  EXPECT_THAT(standby, Not(HasSubstr("tessera_jobs")));
  server->Replace(sources_);
  const std::string active = HttpGet(server->address(), "/metrics");
  EXPECT_THAT(active, HasSubstr("tessera_coordinator_active 1"));
  EXPECT_THAT(active, HasSubstr("tessera_jobs"));
}

// Every metric that deploy/alarms.yml uses exists from the start.
TEST_F(MetricsTest, AlarmsUseExistingMetrics) {
  std::ifstream rules(TESSERA_SOURCE_DIR "/deploy/alarms.yml");
  std::set<std::string> asked;
  const std::regex name("tessera_[a-z_]+");
  for (std::string line; std::getline(rules, line);) {
    for (std::sregex_iterator it(line.begin(), line.end(), name), end; it != end; ++it) asked.insert(it->str());
  }
  EXPECT_GE(asked.size(), 10u);
  const std::string text = Text();
  for (const std::string& metric : asked) {
    const std::regex sample("(^|\n)" + metric + "(\\{[^\n]*\\})? ");
    EXPECT_TRUE(std::regex_search(text, sample)) << metric;
  }
}

// What the command says, and whether it succeeds.
std::pair<bool, std::string> Shell(const std::string& command) {
  std::FILE* const out = ::popen((command + " 2>&1").c_str(), "r");
  std::string said;
  char bytes[4096];
  for (size_t n = 0; (n = std::fread(bytes, 1, sizeof(bytes), out)) > 0;) said.append(bytes, n);
  return {::pclose(out) == 0, said};
}

TEST_F(MetricsTest, AlarmsAreValidForPrometheus) {
  if (!Shell("command -v promtool").first) GTEST_SKIP() << "promtool (package prometheus) is not installed";
  const auto [rules_fit, of_rules] = Shell("promtool check rules " TESSERA_SOURCE_DIR "/deploy/alarms.yml");
  EXPECT_TRUE(rules_fit) << of_rules;
  RpcCounts::Count(rpcs_.Of("/tessera.v1.Jobs/CreateJob"), 3, 0.2);
  Create(AJob(2));
  WorkAll(Worker());
  HttpCounts http({"GET /api/v1/jobs/{job}"});
  sources_.http = &http;
  std::ofstream(folder_.path() + "/metrics") << Text();
  const auto [metrics_fit, of_metrics] = Shell("promtool check metrics < " + folder_.path() + "/metrics");
  EXPECT_TRUE(metrics_fit) << of_metrics;
}

}  // namespace
}  // namespace tessera
