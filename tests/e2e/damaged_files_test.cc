// Damaged and missing stored files are computed again to the same bytes, with the real executables.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "common/storage/folder_blobs.h"
#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class DamagedFilesTest : public testing::Test {
 protected:
  // Every stored file: one is flipped in a byte, the next cut, the next removed. How many there were.
  static int HarmAll(const std::string& data) {
    const std::vector<std::string> blobs = BlobsIn(data + "/blobs");
    for (size_t i = 0; i < blobs.size(); ++i) HarmFile(blobs[i], static_cast<Harm>(i % 3));
    return static_cast<int>(blobs.size());
  }

  TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
};

TEST_F(DamagedFilesTest, DamagedFilesAreRecomputedToTheSameBytes) {
  Cluster cluster(folder_.path());
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  Program& first = cluster.AddWorker();
  ASSERT_TRUE(WaitUntil([&] {
    const std::vector<v1::Task> tasks = cluster.Tasks(job);
    return std::any_of(tasks.begin(), tasks.end(), [](const v1::Task& task) {
      return task.kind() == "solve" && task.state() == v1::TASK_STATE_SUCCEEDED;
    });
  }));
  first.Kill();
  EXPECT_GT(HarmAll(cluster.data()), 10);
  cluster.AddWorker();
  const v1::Job ended = cluster.Await(job);
  ASSERT_EQ(ended.state(), v1::JOB_STATE_SUCCEEDED) << ended.error();
  EXPECT_EQ(Content(cluster.Fetch(job) + "/mesh.ply"), Content(UndisturbedMesh()));
  EXPECT_THAT(cluster.coordinator().Output(), HasSubstr("result lost: its task runs again"));
  EXPECT_FALSE(fs::is_empty(cluster.data() + "/blobs/quarantine"));
  // What nobody needs stays lost; what is asked for is made again, by a worker without the shared folder too.
  EXPECT_GT(HarmAll(cluster.data()), 10);
  cluster.workers().back()->Kill();
  cluster.AddWorker({"--no-shared-storage"});
  const std::string again = cluster.Submit(ToyCity(), 4).name();
  const v1::Job ended_again = cluster.Await(again);
  ASSERT_EQ(ended_again.state(), v1::JOB_STATE_SUCCEEDED) << ended_again.error();
  v1::Job published = ended_again;
  for (const v1::Artifact& artifact : published.artifacts()) {
    if (artifact.name() != "mesh.ply") continue;
    const auto store = *FolderBlobs::Open(folder_.path() + "/fetched-again");
    const Digest digest{artifact.digest().sha256(), artifact.digest().size_bytes()};
    ASSERT_TRUE(WaitUntil([&] { return cluster.connection().blobs().Fetch(digest, *store, {}).ok(); }));
    EXPECT_EQ(*store->Read(digest), Content(UndisturbedMesh()));
  }
}

}  // namespace
}  // namespace tessera::e2e
