// Network partition: coordinator and workers in separate network namespaces, joined by a virtual cable.
#include <gtest/gtest.h>
#include <sched.h>

#include <chrono>
#include <filesystem>

#include "tests/e2e/namespaces.h"
#include "tests/e2e/programs.h"
#include "tests/e2e/record_audit.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;

class PartitionTest : public testing::Test {
 protected:
  Outcome Shell(const std::string& script) {
    return Program(folder_.path(), "/bin/sh", {"-c", "exec 2>&1; set -e; " + script}).Wait();
  }
  // Whether a program is in another network than this process.
  static bool IsApart(pid_t pid) {
    std::error_code error;
    const fs::path own = fs::read_symlink("/proc/self/ns/net", error);
    const fs::path other = fs::read_symlink("/proc/" + std::to_string(pid) + "/ns/net", error);
    return !error && own != other;
  }

  TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
};

TEST_F(PartitionTest, WorkersRecoverFromNetworkPartition) {
  constexpr double kLease_s = 2;
  if (const Status own = EnterNamespaces(CLONE_NEWNET); !own.ok()) GTEST_SKIP() << own.message();
  Program there(folder_.path(), "/usr/bin/unshare", {"--net", "/bin/sleep", "infinity"});
  ASSERT_TRUE(WaitUntil([&] { return !there.Running() || IsApart(there.pid()); }));
  const std::string pid = std::to_string(there.pid());
  const Outcome joined = Shell("ip link add near type veth peer name far netns " + pid +
                               "; ip addr add 10.77.0.1/30 dev near; ip link set near up; nsenter --target " + pid +
                               " --net sh -c 'ip addr add 10.77.0.2/30 dev far && ip link set far up'");
  if (joined.exit_code != 0) GTEST_SKIP() << "no cable between two networks here: " << joined.output;

  Cluster cluster(folder_.path(), kLease_s, {"--insecure"}, "10.77.0.1");
  const std::vector<std::string> there_too = {"/usr/bin/nsenter", "--target", pid, "--net"};
  Program& sharing = cluster.AddWorker({}, there_too);
  Program& other = cluster.AddWorker({"--no-shared-storage"}, there_too);
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  const auto leased = [&](const std::string& kind) {
    int count = 0;
    for (const v1::Task& task : cluster.Tasks(job))
      count += task.state() == v1::TASK_STATE_LEASED && task.kind() == kind;
    return count;
  };
  ASSERT_TRUE(WaitUntil([&] { return leased("measure") == 2; }));
  ASSERT_EQ(Shell("ip link set near down").exit_code, 0);
  // All leases run out; nobody else is there.
  const auto lost = [&] {
    int count = 0;
    for (const v1::Task& task : cluster.Tasks(job)) {
      if (task.state() == v1::TASK_STATE_LEASED) return 0;
      count += task.error().message().find("fell silent") != std::string::npos;
    }
    return count;
  };
  ASSERT_TRUE(WaitUntil([&] { return lost() > 0; }));
  EXPECT_LE(lost(), 2);
  int done = 0;
  for (const v1::Task& task : cluster.Tasks(job)) done += task.state() == v1::TASK_STATE_SUCCEEDED;
  ASSERT_EQ(Shell("ip link set near up").exit_code, 0);
  const auto up = std::chrono::steady_clock::now();
  ASSERT_TRUE(WaitUntil([&] {
    int now = 0;
    for (const v1::Task& task : cluster.Tasks(job)) now += task.state() == v1::TASK_STATE_SUCCEEDED;
    return now > done;
  })) << sharing.Output()
      << other.Output();
  const std::chrono::duration<double> back = std::chrono::steady_clock::now() - up;
  std::printf("a task was done %.1f s after the link was up, %.1f leases\n", back.count(), back.count() / kLease_s);
  const v1::Job ended = cluster.Await(job);
  ASSERT_EQ(ended.state(), v1::JOB_STATE_SUCCEEDED) << ended.error();
  EXPECT_TRUE(Content(cluster.Fetch(job) + "/mesh.ply") == Content(UndisturbedMesh()));
  for (const v1::Task& task : cluster.Tasks(job)) EXPECT_LE(task.attempt(), 2) << task.title();
  cluster.coordinator().Kill();
  const RecordAudit audit = AuditRecords(cluster.data() + "/state.sqlite");
  EXPECT_EQ(audit.faults(), std::vector<std::string>());
  EXPECT_EQ(audit.jobs().at(job).ends, 1);
  EXPECT_TRUE(sharing.Running() && other.Running());
}

}  // namespace
}  // namespace tessera::e2e
