// Full disks: small file systems for the coordinator's state, for blobs and for a worker's scratch.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>

#include <algorithm>
#include <optional>

#include "tests/e2e/namespaces.h"
#include "tests/e2e/programs.h"
#include "tests/e2e/record_audit.h"

namespace tessera::e2e {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Key;

constexpr int64_t kDisk_bytes = int64_t{256} << 20, kSmall_bytes = 300 << 10;

TEST(FullDiskTest, JobSurvivesFullDisksOfStateBlobsAndScratch) {
  if (const Status own = EnterNamespaces(CLONE_NEWNS); !own.ok()) GTEST_SKIP() << own.message();
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  const std::string state = folder.path() + "/data", blobs = state + "/blobs", scratch = folder.path() + "/scratch";
  for (const auto& [disk, bytes] : {std::pair(state, kDisk_bytes), {blobs, kDisk_bytes}, {scratch, kSmall_bytes}}) {
    if (const Status mounted = MountMemory(disk, bytes); !mounted.ok()) GTEST_SKIP() << mounted.message();
  }
  Cluster cluster(folder.path());
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  cluster.AddWorker({"--work", scratch, "--no-shared-storage"});
  const auto done = [&] {
    const std::vector<v1::Task> tasks = cluster.Tasks(job);
    return std::count_if(tasks.begin(), tasks.end(),
                         [](const v1::Task& task) { return task.state() == v1::TASK_STATE_SUCCEEDED; });
  };
  const auto goes_on = [&] {
    const auto now = done();
    return WaitUntil([&] { return done() > now; });
  };
  const auto told = [&](const std::string& words) {
    return WaitUntil([&] { return cluster.coordinator().Output().find(words) != std::string::npos; });
  };

  // One worker has too little room, and gets no tasks; another does them.
  ASSERT_TRUE(told("worker suspended"));
  EXPECT_THAT(Tessera(folder.path(), {"jobs", "--workers", "--coordinator", cluster.address()}).output,
              AllOf(HasSubstr("suspended for"), HasSubstr("No space left on device")));
  EXPECT_EQ(cluster.Tasks(job).at(0).error().error_class(), v1::ERROR_CLASS_SCRATCH);
  cluster.AddWorker();
  ASSERT_TRUE(goes_on());

  std::optional<FullDisk> full(state);
  ASSERT_TRUE(told("journal write failed"));
  EXPECT_THAT(Tessera(folder.path(), {"jobs", job, "--coordinator", cluster.address()}).output,
              HasSubstr("database or disk is full"));
  full.reset();
  ASSERT_TRUE(told("journal writes succeed again"));
  ASSERT_TRUE(goes_on());

  // While tiles are refined: earlier, the planning may wait for room in place of a worker.
  ASSERT_TRUE(WaitUntil([&] {
    const std::vector<v1::Task> tasks = cluster.Tasks(job);
    return std::any_of(tasks.begin(), tasks.end(), [](const v1::Task& task) {
      return task.kind() == "solve" && task.state() == v1::TASK_STATE_SUCCEEDED;
    });
  }));
  full.emplace(blobs);
  ASSERT_TRUE(WaitUntil([&] {
    const std::vector<v1::Task> tasks = cluster.Tasks(job);
    return std::any_of(tasks.begin(), tasks.end(), [](const v1::Task& task) {
      return task.stage().find("waiting for storage space") != std::string::npos;
    });
  }));
  full.reset();
  ASSERT_TRUE(goes_on());
  const v1::Job ended = cluster.Await(job);
  ASSERT_EQ(ended.state(), v1::JOB_STATE_SUCCEEDED) << ended.error();
  EXPECT_TRUE(Content(cluster.Fetch(job) + "/mesh.ply") == Content(UndisturbedMesh()));
  for (const auto& worker : cluster.workers()) EXPECT_TRUE(worker->Running());
  cluster.coordinator().Kill();
  const RecordAudit audit = AuditRecords(state + "/state.sqlite");
  EXPECT_EQ(audit.faults(), std::vector<std::string>());
  // Where there is no room for what was done, it waits: nothing is done twice.
  EXPECT_THAT(audit.failures(), ElementsAre(Key("ERROR_CLASS_SCRATCH")));
}

}  // namespace
}  // namespace tessera::e2e
