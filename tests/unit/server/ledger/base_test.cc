// Updates: states of tiles and measured costs from the records of the base jobs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/job/task_parameters.h"
#include "server/ledger/base_of.h"
#include "server/ledger/check_record.h"
#include "server/ledger/ledger.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr int kTiles = 2;

struct Made {
  std::string kind;
  int tile = -1;
  std::vector<std::string> outputs;  // by name; content: "job name tile"
  double cost = 0, used = 0;         // used 0: reused
  double scale = 1;
};

class BaseTest : public testing::Test {
 protected:
  void Apply(const v1::Record& record) {
    const Status status = CheckRecord(ledger_, record);
    ASSERT_TRUE(status.ok()) << status;
    ledger_.Apply(record);
  }

  static void Fill(const std::string& content, v1::Digest* digest) {
    digest->set_sha256(Sha256Hex(content));
    digest->set_size_bytes(1);
  }

  // Adds a succeeded job with these tasks and a publish task. Task 0 has city and survey; tile t's state comes from
  // tasks[state_of[t]].
  std::string Finish(const UpdateSettings& update, const std::vector<Made>& tasks, const std::vector<int>& state_of) {
    const std::string name = JobName(static_cast<int>(ledger_.jobs().size()));
    v1::Record accepted;
    accepted.mutable_job_accepted()->set_job(name);
    accepted.mutable_job_accepted()->set_algorithm_version("7");
    v1::UpdateSettings& settings = *accepted.mutable_job_accepted()->mutable_settings()->mutable_update();
    settings.set_base(update.base);
    settings.set_rollback_to(update.rollback_to);
    Apply(accepted);
    v1::Record planned;
    planned.mutable_tasks_planned()->set_job(name);
    const auto plan = [&](const std::string& kind, const std::string& parameters) -> v1::PlannedTaskRecord& {
      v1::PlannedTaskRecord& task = *planned.mutable_tasks_planned()->add_tasks();
      task.set_kind(kind);
      task.set_title(kind + std::to_string(planned.tasks_planned().tasks_size()));
      task.set_parameters_json(parameters);
      return task;
    };
    for (size_t t = 0; t < tasks.size(); ++t) {
      v1::PlannedTaskRecord& task = plan(tasks[t].kind, name + std::to_string(t));
      task.set_cost(tasks[t].cost);
      task.set_scale(tasks[t].scale);
    }
    PublishParameters parameters;
    parameters.flip_edges = true;
    for (int t = 0; t < kTiles; ++t) parameters.tiles.push_back({t, {t, 0, t + 1, 1}});
    v1::PlannedTaskRecord& publish = plan(kPublishKind, ToJson(parameters));
    const auto read = [&](int task, const std::string& output, int tile) {
      v1::PlannedInputRecord& input = *publish.add_inputs();
      input.set_task(task);
      input.set_output(output);
      if (tile >= 0) input.set_tile(tile);
    };
    read(0, kCityFile, -1);
    read(0, kPlainSurveyFile, -1);
    for (int t = 0; t < kTiles; ++t) read(state_of[t], kStateFile, t);
    Apply(planned);
    std::vector<Made> all = tasks;
    all.push_back({kPublishKind, -1, {kMeshFile}, 0, 0.25});
    const int job = static_cast<int>(ledger_.jobs().size()) - 1;
    for (int t = 0; t < static_cast<int>(all.size()); ++t) {
      v1::Record done;
      v1::TaskSucceeded& succeeded = *done.mutable_task_succeeded();
      succeeded.set_task(TaskName({job, t}));
      succeeded.set_key(Sha256Hex(name + std::to_string(t)));
      succeeded.set_reused(all[t].used == 0);
      for (const std::string& output : all[t].outputs) {
        succeeded.add_outputs()->set_name(output);
        Fill(name + " " + output + " " + std::to_string(t), succeeded.mutable_outputs()->rbegin()->mutable_digest());
      }
      if (all[t].used > 0) {
        v1::Record started;
        started.mutable_attempt_started()->set_task(succeeded.task());
        started.mutable_attempt_started()->set_attempt(1);
        Apply(started);
        succeeded.set_attempt(1);
        succeeded.mutable_usage()->set_core_seconds(all[t].used);
      }
      Apply(done);
    }
    v1::Record ended;
    ended.mutable_job_ended()->set_job(name);
    ended.mutable_job_ended()->set_state(v1::JOB_STATE_SUCCEEDED);
    Apply(ended);
    return name;
  }

  // A job of two tiles with a task each, then an update that computes tile 1 and reuses tile 0.
  void FinishTwo() {
    const std::vector<std::string> of_survey = {kCityFile, kSurveyFile, kPlainSurveyFile};
    first_ = Finish(
        {}, {{kIngestKind, -1, of_survey, 10, 40}, {"solve", 0, {kStateFile}, 8, 4}, {"solve", 1, {kStateFile}, 8, 6}},
        {1, 2});
    UpdateSettings update;
    update.base = first_;
    second_ = Finish(update,
                     {{kUpdateKind, -1, {of_survey.begin(), of_survey.end()}, 5, 1},
                      {"solve", 0, {kStateFile}, 100, 0},
                      {"solve", 1, {kStateFile}, 3, 2, 0.5}},
                     {1, 2});
  }

  Ledger ledger_{"7"};
  std::string first_, second_;
};

TEST_F(BaseTest, MeasuredCostsAreOfTasksThatRanWithoutTheScale) {
  FinishTwo();
  const MeasuredCosts of_first = BaseOf(ledger_, first_)->measured;
  EXPECT_EQ(of_first.at("solve").predicted, 16);
  EXPECT_EQ(of_first.at("solve").used, 10);
  EXPECT_EQ(of_first.at(kIngestKind).used, 40);
  EXPECT_FALSE(of_first.contains(kPublishKind)) << "planned without a scale, by the model of an earlier release";
  const MeasuredCosts of_second = BaseOf(ledger_, second_)->measured;
  EXPECT_EQ(of_second.at("solve").predicted, 16 + 6) << "without the scale of 0.5 and without reused tasks";
  EXPECT_EQ(of_second.at("solve").used, 10 + 2);
  EXPECT_FALSE(of_second.contains(kUpdateKind)) << "planned before the survey's cost is known";
  EXPECT_FALSE(of_second.contains(kIngestKind)) << "not the survey of the base job";
}

TEST_F(BaseTest, ChainEndsAtTheFirstJob) {
  FinishTwo();
  const auto chain = ChainTo(ledger_, second_, first_);
  ASSERT_TRUE(chain.ok()) << chain.status();
  ASSERT_EQ(chain->size(), 2u);
  EXPECT_EQ(chain->front().name, second_);
  EXPECT_EQ(chain->back().name, first_);
  const Status other = ChainTo(ledger_, second_, "jobs/9").status();
  EXPECT_EQ(other.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(other.message()), AllOf(HasSubstr("jobs/9"), HasSubstr(second_ + ": " + first_)));
  EXPECT_THAT(std::string(ChainTo(ledger_, second_, second_).status().message()),
              HasSubstr("a base job of jobs/2: " + first_));
  EXPECT_THAT(std::string(ChainTo(ledger_, first_, second_).status().message()), HasSubstr("to have a base job"));
}

TEST_F(BaseTest, RollbackTakesItsTilesFromTheEarlierJob) {
  FinishTwo();
  EXPECT_TRUE(BaseOf(ledger_, first_)->flip_edges) << "from the publish parameters";
  const std::vector<Digest> before = BaseOf(ledger_, first_)->states, after = BaseOf(ledger_, second_)->states;
  UpdateSettings update;
  update.base = second_;
  update.rollback_to = first_;
  update.rollback_tiles = {1};
  const auto base = BaseOf(ledger_, update);
  ASSERT_TRUE(base.ok()) << base.status();
  EXPECT_EQ(base->name, second_);
  EXPECT_THAT(base->states, ElementsAre(after[0], before[1]));
  EXPECT_EQ(base->plain.sha256, Sha256Hex(second_ + " " + kPlainSurveyFile + " 0"));
}

TEST_F(BaseTest, ExportsReadTheMeshAndAreNoBases) {
  FinishTwo();
  UpdateSettings only;
  only.base = second_;
  only.export_only = true;
  const auto base = BaseOf(ledger_, only);
  ASSERT_TRUE(base.ok()) << base.status();
  EXPECT_EQ(base->mesh.sha256, Sha256Hex(second_ + " " + kMeshFile + " 3"));
  EXPECT_FALSE(base->changes);
  EXPECT_THAT(base->quarantined, testing::IsEmpty());

  // A job that exports it: its plan is complete, and it must go before its base.
  v1::Record accepted, planned, ended;
  accepted.mutable_job_accepted()->set_job("jobs/3");
  accepted.mutable_job_accepted()->set_algorithm_version("7");
  accepted.mutable_job_accepted()->mutable_settings()->mutable_update()->set_base(second_);
  accepted.mutable_job_accepted()->mutable_settings()->mutable_update()->set_export_only(true);
  Apply(accepted);
  v1::TasksPlanned& plan = *planned.mutable_tasks_planned();
  plan.set_job("jobs/3");
  v1::PlannedTaskRecord& given = *plan.add_tasks();
  given.set_kind(kBaseKind);
  given.set_title(kBaseKind);
  given.add_given()->set_name(kMeshFile);
  Fill("mesh", given.mutable_given(0)->mutable_digest());
  plan.add_tasks()->set_kind(kExportKind);
  plan.mutable_tasks(1)->set_title(kExportKind);
  Apply(planned);
  EXPECT_TRUE(ledger_.jobs()[2].planned_to_end);
  EXPECT_THAT(std::string(CheckMayDelete(ledger_, 1).message()), HasSubstr("delete jobs/3 first"));
  only.base = "jobs/3";
  EXPECT_THAT(std::string(BaseOf(ledger_, only).status().message()), HasSubstr("no result, or not yet"));
  ended.mutable_job_ended()->set_job("jobs/3");
  ended.mutable_job_ended()->set_state(v1::JOB_STATE_FAILED);
  Apply(ended);
  EXPECT_EQ(BaseOf(ledger_, only).status().code(), absl::StatusCode::kFailedPrecondition);
  only.base = "jobs/9";
  EXPECT_EQ(BaseOf(ledger_, only).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace tessera
