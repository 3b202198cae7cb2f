#include "server/client/timeline.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "tessera/v1/jobs.pb.h"
#include "tessera/v1/tasks.pb.h"

namespace tessera {
namespace {

using nlohmann::json;

constexpr int64_t kZero_s = 1'700'000'000;

v1::Job AJob() {
  v1::Job job;
  job.set_name("jobs/3");
  job.set_display_name("a \"city\"\n");
  job.set_state(v1::JOB_STATE_RUNNING);
  job.mutable_create_time()->set_seconds(kZero_s);
  return job;
}

v1::Attempt AnAttempt(int task, const std::string& worker, int start_s, int end_s,
                      v1::AttemptOutcome outcome = v1::ATTEMPT_OUTCOME_SUCCEEDED) {
  v1::Attempt attempt;
  attempt.set_task("jobs/3/tasks/" + std::to_string(task));
  attempt.set_attempt(1);
  attempt.set_kind("solve");
  attempt.set_title("solve tile " + std::to_string(task));
  attempt.set_tile(task);
  attempt.set_worker(worker);
  attempt.set_machine(worker == "workers/1-3" ? "b/boot" : "a/boot");
  attempt.mutable_start_time()->set_seconds(kZero_s + start_s);
  if (end_s >= 0) attempt.mutable_end_time()->set_seconds(kZero_s + end_s);
  attempt.set_outcome(outcome);
  return attempt;
}

std::vector<json> Slices(const json& trace) {
  std::vector<json> slices;
  for (const json& event : trace["traceEvents"]) {
    if (event["ph"] == "X") slices.push_back(event);
  }
  return slices;
}

TEST(Timeline, HasOneTrackPerWorkerAndOneSlicePerAttempt) {
  v1::Attempt failed = AnAttempt(2, "workers/1-1", 30, 50, v1::ATTEMPT_OUTCOME_FAILED);
  failed.mutable_error()->set_error_class(v1::ERROR_CLASS_LOST_INPUT);
  failed.mutable_error()->set_message("no such\nfile");
  const std::vector<v1::Attempt> attempts = {
      failed,
      AnAttempt(0, "workers/1-1", 10, 30),
      AnAttempt(1, "workers/1-2", 10, 20, v1::ATTEMPT_OUTCOME_LEASE_EXPIRED),
      AnAttempt(3, "workers/1-3", 40, 45, v1::ATTEMPT_OUTCOME_CANCELLED),
      AnAttempt(4, "workers/1-3", 60, -1, v1::ATTEMPT_OUTCOME_RUNNING),
  };
  const json trace = json::parse(TimelineJson(AJob(), attempts, (kZero_s + 100) * 1'000'000));
  EXPECT_EQ(trace["otherData"]["name"], "a \"city\"\n");
  std::map<std::string, std::set<std::string>> names;  // of processes and rows
  for (const json& event : trace["traceEvents"]) {
    if (event["ph"] == "M") names[event["name"]].insert(event["args"]["name"]);
  }
  EXPECT_EQ(names["process_name"], (std::set<std::string>{"a/boot", "b/boot"}));
  EXPECT_EQ(names["thread_name"], (std::set<std::string>{"workers/1-1", "workers/1-2", "workers/1-3"}));
  std::map<std::string, json> of_task;
  for (const json& slice : Slices(trace)) of_task[slice["args"]["task"]] = slice;
  ASSERT_EQ(of_task.size(), attempts.size());
  const json& good = of_task["jobs/3/tasks/0"];
  EXPECT_EQ(good["name"], "solve tile 0");
  EXPECT_EQ(good["cat"], "solve");
  EXPECT_EQ(good["ts"], 10'000'000);
  EXPECT_EQ(good["dur"], 20'000'000);
  EXPECT_EQ(good["args"]["outcome"], "succeeded");
  EXPECT_EQ(good["args"]["tile"], 0);
  const json& bad = of_task["jobs/3/tasks/2"];
  EXPECT_EQ(bad["name"], "solve tile 2 (lost input)");
  EXPECT_EQ(bad["cat"], "solve,failed");
  EXPECT_EQ(bad["args"]["error"], "no such\nfile");
  EXPECT_EQ(bad["tid"], good["tid"]);
  EXPECT_EQ(of_task["jobs/3/tasks/1"]["name"], "solve tile 1 (lease expired)");
  EXPECT_EQ(of_task["jobs/3/tasks/3"]["name"], "solve tile 3 (cancelled)");
  EXPECT_EQ(of_task["jobs/3/tasks/3"]["cat"], "solve");
  EXPECT_EQ(of_task["jobs/3/tasks/4"]["dur"], 40'000'000) << "until now";
  EXPECT_NE(of_task["jobs/3/tasks/4"]["pid"], good["pid"]);
}

TEST(Timeline, SlicesOfATrackDoNotOverlap) {
  std::vector<v1::Attempt> attempts;
  for (int i = 0; i < 40; ++i) {
    const int start_s = (i * 37) % 50;
    attempts.push_back(AnAttempt(i, "workers/1-" + std::to_string(1 + i % 3), start_s, start_s + i % 5));
  }
  const json trace = json::parse(TimelineJson(AJob(), attempts, 0));
  EXPECT_EQ(Slices(trace).size(), attempts.size());
  std::map<std::pair<int, int>, std::map<int64_t, int64_t>> of_row;  // ends by starts
  for (const json& slice : Slices(trace)) {
    const int64_t start = slice["ts"], end = start + slice["dur"].get<int64_t>();
    auto& row = of_row[{slice["pid"], slice["tid"]}];
    for (const auto& [other_start, other_end] : row) {
      EXPECT_TRUE(end <= other_start || other_end <= start) << start << " " << other_start;
    }
    row[start] = std::max(row[start], end);
  }
  EXPECT_GT(of_row.size(), 3u) << "some workers seemed to do two things at once";
}

TEST(Timeline, JobWithoutAttemptsGivesAValidTrace) {
  EXPECT_TRUE(json::parse(TimelineJson(AJob(), {}, 0))["traceEvents"].empty());
}

}  // namespace
}  // namespace tessera
