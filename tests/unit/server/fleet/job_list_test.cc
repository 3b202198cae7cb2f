#include "server/fleet/job_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tessera {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

FleetFile TwoClassesForLists() {
  FleetFile fleet;
  fleet.name = "city";
  fleet.logs = "/logs";
  fleet.classes.resize(2);
  fleet.classes[0].name = "small";
  fleet.classes[1].name = "large";
  return fleet;
}

StatusOr<std::vector<Pilot>> Slurm(const std::string& jobs, const std::string& errors = "[]") {
  return ParseSlurmJobs(
      R"({"meta": {"Slurm": {"version": {"major": 22}}}, "errors": )" + errors + R"(, "jobs": [)" + jobs + "]}",
      TwoClassesForLists(), 1000);
}

// As Slurm 22.05 prints them, shortened.
TEST(SlurmJobsTest, NumbersAndTextsOf22AreRead) {
  const auto pilots = Slurm(R"(
    {"job_id": 5, "array_job_id": 4, "array_task_id": 1, "array_task_string": "", "job_state": "RUNNING",
     "state_reason": "None", "name": "tessera.city.large", "user_id": 1000, "submit_time": 100, "start_time": 101,
     "end_time": 401, "exit_code": 0},
    {"job_id": 4, "array_job_id": 4, "array_task_id": null, "array_task_string": "3-4,7%2", "job_state": "PENDING",
     "state_reason": "Resources", "name": "tessera.city.large", "user_id": 1000, "submit_time": 100, "start_time": 0,
     "end_time": 0, "exit_code": 0},
    {"job_id": 9, "array_job_id": 0, "array_task_id": null, "array_task_string": "", "job_state": "FAILED",
     "state_reason": "NonZeroExitCode", "name": "tessera.city.small", "user_id": 1000, "submit_time": 90,
     "start_time": 91, "end_time": 92, "exit_code": 32512})");
  ASSERT_TRUE(pilots.ok()) << pilots.status();
  ASSERT_EQ(pilots->size(), 5u);
  const Pilot& running = (*pilots)[0];
  EXPECT_EQ(running.job, "4_1");
  EXPECT_EQ(running.allocation, "5");
  EXPECT_EQ(running.pilot_class, 1);
  EXPECT_EQ(running.state, PilotState::kRunning);
  EXPECT_EQ(running.submitted_s, 100);
  EXPECT_EQ(running.started_s, 101);
  EXPECT_EQ(running.output, "/logs/tessera.city.large-4_1.out");
  EXPECT_EQ((*pilots)[1].job, "4_3");
  EXPECT_EQ((*pilots)[2].job, "4_4");
  EXPECT_EQ((*pilots)[3].job, "4_7");
  EXPECT_EQ((*pilots)[3].state, PilotState::kPending);
  EXPECT_EQ((*pilots)[3].reason, "Resources");
  EXPECT_EQ((*pilots)[3].allocation, "");
  const Pilot& failed = (*pilots)[4];
  EXPECT_EQ(failed.job, "9");
  EXPECT_EQ(failed.pilot_class, 0);
  EXPECT_EQ(failed.state, PilotState::kEnded);
  EXPECT_EQ(failed.end, PilotEnd::kFailed);
  EXPECT_EQ(failed.reason, "FAILED, exit code 127");
}

// As Slurm 23.11 and later print them.
TEST(SlurmJobsTest, ObjectsAndListsOfNewerVersionsAreRead) {
  const auto pilots = Slurm(R"(
    {"job_id": 5, "array_job_id": {"set": true, "infinite": false, "number": 4},
     "array_task_id": {"set": true, "infinite": false, "number": 2}, "array_task_string": "",
     "job_state": ["RUNNING"], "state_reason": "None", "name": "tessera.city.small", "user_id": 1000,
     "submit_time": {"set": true, "infinite": false, "number": 100},
     "start_time": {"set": true, "infinite": false, "number": 101}, "end_time": {"set": false, "number": 0},
     "exit_code": {"status": ["SUCCESS"], "return_code": {"set": true, "infinite": false, "number": 0}}},
    {"job_id": 4, "array_job_id": {"set": true, "number": 4}, "array_task_id": {"set": false, "number": 0},
     "array_task_string": "3", "job_state": ["PENDING", "REQUEUED"], "state_reason": "Priority",
     "name": "tessera.city.small", "user_id": 1000, "exit_code": {"return_code": {"set": false, "number": 0}}},
    {"job_id": 6, "array_job_id": {"set": true, "number": 4}, "array_task_id": {"set": true, "number": 5},
     "job_state": ["FAILED"], "name": "tessera.city.small", "user_id": 1000,
     "exit_code": {"status": ["ERROR"], "return_code": {"set": true, "number": 1}}})");
  ASSERT_TRUE(pilots.ok()) << pilots.status();
  ASSERT_EQ(pilots->size(), 3u);
  EXPECT_EQ((*pilots)[0].job, "4_2");
  EXPECT_EQ((*pilots)[0].started_s, 101);
  EXPECT_EQ((*pilots)[0].ended_s, 0);
  EXPECT_EQ((*pilots)[1].job, "4_3");
  EXPECT_EQ((*pilots)[1].state, PilotState::kPending);
  EXPECT_EQ((*pilots)[2].reason, "FAILED, exit code 1");
}

TEST(SlurmJobsTest, JobsOfOthersAreLeftOut) {
  const auto pilots = Slurm(R"(
    {"job_id": 1, "name": "tessera.city.small", "user_id": 1001, "job_state": "RUNNING"},
    {"job_id": 2, "name": "tessera.other.small", "user_id": 1000, "job_state": "RUNNING"},
    {"job_id": 3, "name": "tessera.city.tiny", "user_id": 1000, "job_state": "RUNNING", "job_resources": {"a": [{}]}},
    {"job_id": 4, "name": "tessera.city.small", "user_id": 1000, "job_state": "RUNNING",
     "job_resources": {"a": [{}]}})");
  ASSERT_TRUE(pilots.ok()) << pilots.status();
  ASSERT_EQ(pilots->size(), 1u);
  EXPECT_EQ((*pilots)[0].job, "4");
}

TEST(SlurmJobsTest, EveryStateIsOneOfThree) {
  const auto state_of = [](const std::string& state) {
    const auto pilots =
        Slurm(R"({"job_id": 1, "name": "tessera.city.small", "user_id": 1000, "job_state": )" + state + "}");
    EXPECT_TRUE(pilots.ok()) << pilots.status();
    return pilots->at(0);
  };
  for (const char* state : {"\"RUNNING\"", "\"CONFIGURING\"", "\"SUSPENDED\"", "\"COMPLETING\"", "\"NEW_STATE\"",
                            "[\"COMPLETED\", \"COMPLETING\"]", "[\"RUNNING\", \"CONFIGURING\"]"}) {
    EXPECT_EQ(state_of(state).state, PilotState::kRunning) << state;
  }
  for (const char* state : {"\"PENDING\"", "\"REQUEUED\"", "\"REQUEUE_HOLD\"", "[\"PENDING\"]"}) {
    EXPECT_EQ(state_of(state).state, PilotState::kPending) << state;
  }
  for (const char* state : {"\"CANCELLED\"", "\"PREEMPTED\"", "\"NODE_FAIL\"", "\"BOOT_FAIL\"", "\"DEADLINE\""}) {
    EXPECT_EQ(state_of(state).state, PilotState::kEnded) << state;
    EXPECT_EQ(state_of(state).end, PilotEnd::kTakenAway) << state;
  }
  for (const char* state : {"\"FAILED\"", "\"TIMEOUT\"", "\"OUT_OF_MEMORY\""}) {
    EXPECT_EQ(state_of(state).end, PilotEnd::kFailed) << state;
  }
  EXPECT_EQ(state_of("\"COMPLETED\"").end, PilotEnd::kSucceeded);
}

// `squeue --json` of 22.05 prints this, with exit code 0, if the controller does not answer.
TEST(SlurmJobsTest, ListWithErrorsIsRefused) {
  const auto pilots = Slurm("", R"([{"description": "Failed while looking for jobs", "error_number": -1}])");
  EXPECT_THAT(pilots.status().ToString(), HasSubstr("Failed while looking for jobs"));
}

TEST(SlurmJobsTest, InvalidListsAreRefused) {
  const FleetFile fleet = TwoClassesForLists();
  for (const char* text : {"", "slurm_load_jobs error: Unable to contact slurm controller", "{}", "[]", "{\"jobs\": 3}",
                           "{\"jobs\": [{\"name\": \"tessera.city.small\", \"job_id\": 1, \"job_st",
                           "{\"jobs\": [{\"name\": \"tessera.city.small\", \"job_state\": \"RUNNING\"}]}",
                           "{\"jobs\": [{\"name\": \"tessera.city.small\", \"job_id\": 7}]}",
                           "{\"jobs\": [{\"job_id\": 7, \"job_state\": \"RUNNING\"}]}",
                           "{\"jobs\": [{\"name\": \"tessera.city.small\", \"job_id\": 7, \"job_state\": \"PENDING\","
                           "\"array_task_string\": \"3-...\"}]}"}) {
    EXPECT_EQ(ParseSlurmJobs(text, fleet, 1000).status().code(), absl::StatusCode::kInvalidArgument) << text;
  }
  EXPECT_THAT(ParseSlurmJobs("{\"jobs\": []}", fleet, 1000).value(), IsEmpty());
}

TEST(JobListTest, StatesOfOtherSchedulersAreRead) {
  const auto pilots = ParseJobList(R"({"jobs": [
    {"id": "a", "name": "tessera.city.small", "state": "pending", "reason": "queue full", "submitted": 5},
    {"id": "b", "name": "tessera.city.large", "state": "running", "started": 6},
    {"id": "c", "name": "tessera.city.large", "state": "running", "allocation": "c@host"},
    {"id": "d", "name": "tessera.city.small", "state": "failed", "output": "/o", "ended": 9},
    {"id": "e", "name": "tessera.city.small", "state": "cancelled"},
    {"id": "f", "name": "tessera.city.small", "state": "succeeded"},
    {"id": "g", "name": "other", "state": "running"}]})",
                                   TwoClassesForLists());
  ASSERT_TRUE(pilots.ok()) << pilots.status();
  ASSERT_EQ(pilots->size(), 6u);
  EXPECT_EQ((*pilots)[0].state, PilotState::kPending);
  EXPECT_EQ((*pilots)[0].reason, "queue full");
  EXPECT_EQ((*pilots)[1].allocation, "b");
  EXPECT_EQ((*pilots)[2].allocation, "c@host");
  EXPECT_EQ((*pilots)[3].end, PilotEnd::kFailed);
  EXPECT_EQ((*pilots)[3].output, "/o");
  EXPECT_EQ((*pilots)[4].end, PilotEnd::kTakenAway);
  EXPECT_EQ((*pilots)[5].end, PilotEnd::kSucceeded);
}

TEST(JobListTest, UnknownStatesAreRefused) {
  for (const char* job :
       {R"({"id": "a", "name": "tessera.city.small", "state": "odd"})",
        R"({"id": "", "name": "tessera.city.small", "state": "running"})", R"({"id": "a", "state": "running"})"}) {
    EXPECT_FALSE(ParseJobList(std::string("{\"jobs\": [") + job + "]}", TwoClassesForLists()).ok()) << job;
  }
}

}  // namespace
}  // namespace tessera
