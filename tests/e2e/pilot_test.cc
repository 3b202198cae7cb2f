// deploy/slurm/pilot with scripts in place of the worker and of squeue.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <filesystem>
#include <fstream>

#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

using testing::HasSubstr;
using testing::Not;

class PilotTest : public testing::Test {
 protected:
  std::string Script(const std::string& name, const std::string& body) {
    const std::string path = folder_.path() + "/" + name;
    std::ofstream(path) << "#!/bin/bash\n" << body;
    std::filesystem::permissions(path, std::filesystem::perms::owner_all);
    return path;
  }
  // The pilot in this environment, with these arguments.
  std::unique_ptr<Program> Start(std::vector<std::string> environment, const std::vector<std::string>& arguments) {
    environment.insert(environment.begin(), {"-i", "PATH=" + folder_.path() + ":/usr/bin:/bin"});
    environment.push_back(TESSERA_PILOT);
    environment.insert(environment.end(), arguments.begin(), arguments.end());
    return std::make_unique<Program>(folder_.path(), "/usr/bin/env", environment);
  }

  TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
  const std::string print_ = Script("tessera-worker", "echo \"options: $*\"\n");
};

TEST_F(PilotTest, TakesOptionsFromTheAllocation) {
  Script("squeue", "[ \"$*\" = '-h -j 17 -o %L' ] && echo 1-02:03:08\n");
  const Outcome outcome =
      Start({"SLURM_JOB_ID=17", "SLURM_MEM_PER_NODE=2048", "SLURM_CPUS_ON_NODE=3"}, {"--coordinator", "a:1"})->Wait();
  EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(outcome.output, HasSubstr("options: --coordinator a:1 --memory 1946MiB --threads 3 --allocation 17 "
                                        "--idle-s 60 --drain-s 20 --time-left 937"));
}

TEST_F(PilotTest, GivenOptionsArePreferred) {
  const Outcome outcome =
      Start({"SLURM_JOB_ID=17", "SLURM_MEM_PER_CPU=1024", "SLURM_CPUS_ON_NODE=2", "SLURM_JOB_END_TIME=99999999999"},
            {print_, "--idle-s", "5", "--drain-s=3", "--time-left", "100", "--threads", "1"})
          ->Wait();
  EXPECT_THAT(outcome.output, HasSubstr("options: --idle-s 5 --drain-s=3 --time-left 100 --threads 1 --memory 1946MiB "
                                        "--allocation 17\n"));
}

TEST_F(PilotTest, UnknownTimeIsLeftOut) {
  Script("squeue", "echo UNLIMITED\n");
  const Outcome outcome = Start({"SLURM_JOB_ID=17"}, {})->Wait();
  EXPECT_THAT(outcome.output, HasSubstr("options: --allocation 17 --idle-s 60 --drain-s 20\n"));
}

TEST_F(PilotTest, EndedAllocationStartsNoWorker) {
  const Outcome outcome = Start({"SLURM_JOB_END_TIME=1000"}, {print_})->Wait();
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_THAT(outcome.output, Not(HasSubstr("options")));
}

TEST_F(PilotTest, KilledWorkerIsStartedAgain) {
  const std::string worker = Script("once", "[ -e \"$0.started\" ] && exit 0\ntouch \"$0.started\"\nkill -KILL $$\n");
  const Outcome outcome = Start({}, {worker})->Wait();
  EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(outcome.output, HasSubstr("exit code 137"));
}

TEST_F(PilotTest, FailedWorkerEndsTheJob) {
  const Outcome outcome = Start({}, {Script("fails", "echo refused\nexit 1\n")})->Wait();
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.output, HasSubstr("refused"));
}

TEST_F(PilotTest, SigtermIsPassedOn) {
  const auto pilot = Start({}, {Script("drains",
                                       "trap 'echo drained; exit 0' TERM\necho ready\n"
                                       "while :; do sleep 0.1; done\n")});
  ASSERT_TRUE(WaitUntil([&] { return pilot->Output().find("ready") != std::string::npos; }));
  pilot->Signal(SIGTERM);
  const Outcome outcome = pilot->Wait();
  EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(outcome.output, HasSubstr("drained"));
}

}  // namespace
}  // namespace tessera::e2e
