#include "server/fleet/run_command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tessera {
namespace {

using testing::HasSubstr;

TEST(RunCommandTest, ReturnsStandardOutputOnly) {
  const auto output = RunCommand({"sh", "-c", "echo list; echo warning >&2"}, {});
  ASSERT_TRUE(output.ok()) << output.status();
  EXPECT_EQ(*output, "list\n");
}

TEST(RunCommandTest, WordsPassNoShell) { EXPECT_EQ(RunCommand({"echo", "$HOME;*"}, {}).value(), "$HOME;*\n"); }

TEST(RunCommandTest, FailureHasTheLastLinesOfErrors) {
  const auto output = RunCommand({"sh", "-c", "echo sbatch: invalid partition >&2; exit 3"}, {});
  EXPECT_EQ(output.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(output.status().ToString(), HasSubstr("sh ended with exit code 3:\nsbatch: invalid partition"));
}

TEST(RunCommandTest, MissingProgramIsNamed) {
  EXPECT_THAT(RunCommand({"no-such-squeue"}, {}).status().ToString(), HasSubstr("no-such-squeue"));
}

TEST(RunCommandTest, LimitsEndIt) {
  CommandLimits limits;
  limits.seconds = 0.1;
  EXPECT_EQ(RunCommand({"sleep", "100"}, limits).status().code(), absl::StatusCode::kAborted);
  limits.seconds = 60;
  limits.bytes = 1000;
  EXPECT_EQ(RunCommand({"yes"}, limits).status().code(), absl::StatusCode::kResourceExhausted);
  limits.stop = [] { return true; };
  EXPECT_EQ(RunCommand({"sleep", "100"}, limits).status().code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace tessera
