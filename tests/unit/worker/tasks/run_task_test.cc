// Errors of tasks name the files as the user knows them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "worker/tasks/task.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

TEST(RunTaskTest, ErrorsNameFilesRelativeToTheScene) {
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  const std::string in = folder.path() + "/in", out = folder.path() + "/out";
  ASSERT_TRUE(EnsureFolder(in + "/scene").ok() && EnsureFolder(out).ok());
  ASSERT_TRUE(WriteFileAtomic(in + "/scene/scene.json", R"({"tessera_scene": 1})").ok());
  const auto outcome = RunTask({"ingest", ToJson(IngestParameters()), in, out}, {});
  EXPECT_EQ(outcome.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(outcome.status().message()),
              AllOf(HasSubstr("colmap: found no such folder"), Not(HasSubstr(in))));
}

}  // namespace
}  // namespace tessera
