#include "common/storage/folder_blobs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>
#include <vector>

#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

TEST(HashTest, KnownValues) {
  EXPECT_EQ(Sha256Hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(Sha256Hex(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(Xxh3(""), 0x2d06800538d394c2ull);
  Sha256Hasher hasher;
  hasher.Update("a");
  hasher.Update("bc");
  EXPECT_EQ(hasher.Finish(), Sha256Hex("abc"));
  EXPECT_FALSE(CheckDigest({"../../etc/passwd", 3}).ok());
  EXPECT_FALSE(CheckDigest({std::string(64, 'A'), 3}).ok());
}

class FolderBlobsTest : public testing::Test {
 protected:
  std::string File(const std::string& content) {
    const std::string path = folder_.path() + "/file";
    std::ofstream(path, std::ios::binary) << content;
    return path;
  }
  static Digest DigestOf(const std::string& content) {
    return {Sha256Hex(content), static_cast<int64_t>(content.size())};
  }
  size_t FileCount() const { return ListFiles(store_->root())->size(); }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  std::unique_ptr<FolderBlobs> store_ = *FolderBlobs::Open(folder_.path() + "/blobs");
  const std::string content_ = std::string(300000, 'x') + "end";
};

TEST_F(FolderBlobsTest, BlobIsOneFile) {
  const Digest digest = DigestOf(content_);
  EXPECT_FALSE(store_->Has(digest));
  EXPECT_EQ(*store_->PutFile(File(content_)), digest);
  EXPECT_TRUE(store_->Has(digest));
  EXPECT_EQ(*store_->MoveFile(File(content_)), digest);
  EXPECT_FALSE(FileExists(folder_.path() + "/file"));
  EXPECT_EQ(*store_->PutBytes(content_), digest);
  EXPECT_EQ(*store_->Read(digest), content_);
  EXPECT_EQ(FileCount(), 1u);
  EXPECT_FALSE(store_->PutFile(folder_.path() + "/none").ok());
  EXPECT_FALSE(store_->MoveFile(folder_.path() + "/none").ok());
  EXPECT_EQ(FileCount(), 1u);
}

// Readers of a blob must not see its file change when another process stores the same content.
TEST_F(FolderBlobsTest, StoringAnExistingBlobDoesNotReplaceItsFile) {
  const Digest digest = *store_->MoveFile(File(content_));
  const std::string path = *store_->LocalPath(digest);
  fs::last_write_time(path, fs::last_write_time(path) - std::chrono::hours(1));
  const auto before = fs::last_write_time(path);
  EXPECT_EQ(*store_->MoveFile(File(content_)), digest);
  EXPECT_EQ(*store_->PutFile(File(content_)), digest);
  EXPECT_EQ(fs::last_write_time(path), before);
  EXPECT_EQ(FileCount(), 1u);
  std::ofstream(path, std::ios::binary) << "damaged";
  EXPECT_EQ(*store_->MoveFile(File(content_)), digest);
  EXPECT_TRUE(store_->Verify(digest).ok());
  EXPECT_EQ(FileCount(), 1u);
}

TEST_F(FolderBlobsTest, DamagedBlobIsMovedToTheQuarantineFolder) {
  const Digest digest = *store_->PutFile(File(content_));
  EXPECT_TRUE(store_->VerifyOrQuarantine(digest).ok());
  EXPECT_TRUE(store_->Has(digest));
  std::string damaged = content_;
  damaged[5] ^= 1;
  std::ofstream(*store_->LocalPath(digest), std::ios::binary) << damaged;
  EXPECT_TRUE(store_->Has(digest)) << "Has does not read the content";
  const Status status = store_->VerifyOrQuarantine(digest);
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_FALSE(store_->Has(digest));
  EXPECT_EQ(store_->VerifyOrQuarantine(digest).code(), absl::StatusCode::kNotFound);
  const std::string where(status.message());
  EXPECT_EQ(ReadFile(where.substr(where.find(store_->root() + "/quarantine/"))).value(), damaged) << where;
  EXPECT_EQ(*store_->CommittedBytes(digest), 0);
  ASSERT_TRUE(store_->Append(digest, 0, content_).ok());
  ASSERT_TRUE(store_->Complete(digest).ok());
  EXPECT_EQ(*store_->Read(digest), content_);
}

TEST_F(FolderBlobsTest, FileThatCannotBeStoredIsKept) {
  const std::string file = File(content_);
  const Digest digest = DigestOf(content_);
  const std::string folder = folder_.path() + "/blobs/" + digest.sha256.substr(0, 2);
  std::ofstream(folder) << "not a folder";
  EXPECT_FALSE(store_->MoveFile(file).ok());
  EXPECT_EQ(*ReadFile(file), content_);
  fs::remove(folder);
  EXPECT_EQ(*store_->MoveFile(file), digest);
}

// Like containers that share the folder: each process has id 1 in its own PID namespace.
TEST_F(FolderBlobsTest, ProcessesWithEqualIdsDoNotCollide) {
  constexpr int kProcesses = 4, kBlobs = 60;
  const auto content = [](int process, int blob) {
    return std::string(200'000 + 1000 * process, static_cast<char>('a' + process)) + std::to_string(blob);
  };
  const std::string root = folder_.path() + "/shared";
  const auto store = *FolderBlobs::Open(root);
  std::vector<pid_t> children;
  for (int process = 0; process < kProcesses; ++process) {
    const pid_t outer = fork();
    if (outer == 0) {
      if (unshare(CLONE_NEWPID) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWPID) != 0) _exit(2);
      const pid_t inner = fork();
      if (inner == 0) {
        const std::string file = folder_.path() + "/file-" + std::to_string(process);
        for (int blob = 0; blob < kBlobs; ++blob) {
          std::ofstream(file, std::ios::binary) << content(process, blob);
          if (!store->PutFile(file).ok()) _exit(1);
        }
        _exit(getpid() == 1 ? 0 : 3);
      }
      int status = 0;
      waitpid(inner, &status, 0);
      _exit(WIFEXITED(status) ? WEXITSTATUS(status) : 4);
    }
    children.push_back(outer);
  }
  bool allowed = true;
  for (const pid_t child : children) {
    int status = 0;
    waitpid(child, &status, 0);
    ASSERT_TRUE(WIFEXITED(status));
    if (WEXITSTATUS(status) == 2) allowed = false;
    EXPECT_TRUE(WEXITSTATUS(status) == 0 || WEXITSTATUS(status) == 2) << WEXITSTATUS(status);
  }
  if (!allowed) GTEST_SKIP() << "no PID namespaces here";
  for (int process = 0; process < kProcesses; ++process) {
    for (int blob = 0; blob < kBlobs; ++blob) {
      EXPECT_TRUE(store->Verify(DigestOf(content(process, blob))).ok()) << process << ", " << blob;
    }
  }
  EXPECT_TRUE(fs::is_empty(root + "/partial"));
}

}  // namespace
}  // namespace tessera
