// Stored files that are damaged or vanish, and workers that cannot work, on real processes: the same bytes all the
// same.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "common/storage/blob_store.h"
#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class RotTest : public testing::Test {
 protected:
  // Every stored file: one is flipped in a byte, the next cut, the next removed. How many there were.
  static int HarmAll(const std::string& data) {
    std::vector<fs::path> blobs;
    for (const auto& entry : fs::recursive_directory_iterator(data + "/blobs")) {
      if (entry.is_regular_file() && entry.path().filename().string().size() == 64) blobs.push_back(entry.path());
    }
    std::sort(blobs.begin(), blobs.end());
    for (size_t i = 0; i < blobs.size(); ++i) {
      const auto size = static_cast<std::streamoff>(fs::file_size(blobs[i]));
      if (i % 3 == 0) {
        std::fstream file(blobs[i], std::ios::in | std::ios::out | std::ios::binary);
        file.seekg(size / 2);
        const int byte = file.get();
        file.seekp(size / 2);
        file.put(static_cast<char>(byte ^ 1));
      } else if (i % 3 == 1) {
        fs::resize_file(blobs[i], static_cast<uintmax_t>(size / 2));
      } else {
        fs::remove(blobs[i]);
      }
    }
    return static_cast<int>(blobs.size());
  }

  TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
};

TEST_F(RotTest, AJobWhoseFilesAllRotEndsWithTheSameBytes) {
  Cluster cluster(folder_.path());
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  Program& first = cluster.AddWorker();
  ASSERT_TRUE(WaitUntil([&] {
    const std::vector<v1::Task> tasks = cluster.Tasks(job);
    return std::any_of(tasks.begin(), tasks.end(),
                       [](const v1::Task& task) { return task.kind() == "solve" && task.state() == v1::SUCCEEDED; });
  }));
  first.Kill();
  EXPECT_GT(HarmAll(cluster.data()), 10);
  cluster.AddWorker();
  const v1::Job ended = cluster.Await(job);
  ASSERT_EQ(ended.state(), v1::JOB_SUCCEEDED) << ended.error();
  EXPECT_EQ(Content(cluster.Fetch(job) + "/mesh.ply"), Content(UndisturbedMesh()));
  EXPECT_THAT(cluster.coordinator().Output(), HasSubstr("result lost, made again"));
  EXPECT_FALSE(fs::is_empty(cluster.data() + "/blobs/set_aside"));
  // What nobody needs stays lost; what is asked for is made again, by a worker without the shared folder too.
  EXPECT_GT(HarmAll(cluster.data()), 10);
  cluster.workers().back()->Kill();
  cluster.AddWorker({"--no-shared-storage"});
  const std::string again = cluster.Submit(ToyCity(), 4).name();
  const v1::Job ended_again = cluster.Await(again);
  ASSERT_EQ(ended_again.state(), v1::JOB_SUCCEEDED) << ended_again.error();
  v1::Job published = ended_again;
  for (const v1::Artifact& artifact : published.artifacts()) {
    if (artifact.name() != "mesh.ply") continue;
    const auto store = *BlobStore::Open(folder_.path() + "/fetched-again");
    const Digest digest{artifact.digest().sha256(), artifact.digest().size_bytes()};
    ASSERT_TRUE(WaitUntil([&] { return cluster.connection().blobs().Fetch(digest, *store, {}).ok(); }));
    EXPECT_EQ(*store->Read(digest), Content(UndisturbedMesh()));
  }
}

// One worker has 300 KiB of scratch, the other enough.
TEST_F(RotTest, AWorkerWithAFullScratchFolderIsSetAside) {
  const std::string small = folder_.path() + "/small";
  fs::create_directories(small);
  const std::string mount = "mount -t tmpfs -o size=300k none " + small + " && exec \"$0\" \"$@\"";
  std::vector<std::string> before = {"/usr/bin/unshare", "--mount", "/bin/sh", "-c", mount};
  if (::geteuid() != 0) before.insert(before.begin() + 1, "--map-root-user");
  std::vector<std::string> nothing(before.begin() + 1, before.end());
  nothing.push_back("/bin/true");
  if (Program(folder_.path(), before.front(), nothing).Wait().exit_code != 0) GTEST_SKIP() << "no mounts here";
  Cluster cluster(folder_.path());
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  cluster.AddWorker({"--work", small, "--no-shared-storage"}, before);
  const auto reason = [&]() -> std::string {
    v1::ListWorkersResponse workers;
    EXPECT_TRUE(cluster.connection().ListWorkers(&workers).ok());
    return workers.workers_size() > 0 ? workers.workers(0).set_aside_reason() : "";
  };
  ASSERT_TRUE(WaitUntil([&] { return !reason().empty(); }));
  EXPECT_THAT(reason(), HasSubstr("No space left on device"));
  EXPECT_EQ(cluster.Tasks(job).at(0).error().error_class(), v1::SCRATCH);
  cluster.AddWorker();
  const v1::Job ended = cluster.Await(job);
  EXPECT_EQ(ended.state(), v1::JOB_SUCCEEDED) << ended.error();
}

}  // namespace
}  // namespace tessera::e2e
