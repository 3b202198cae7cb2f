#include "common/storage/files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <set>

#include "common/storage/temporary_name.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class FilesTest : public testing::Test {
 protected:
  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  std::string Path(const std::string& name) const { return folder_.path() + "/" + name; }
};

TEST_F(FilesTest, WritesAtomicallyAndReplaces) {
  ASSERT_TRUE(WriteFileAtomic(Path("a"), "one").ok());
  ASSERT_TRUE(WriteFileAtomic(Path("a"), "two").ok());
  EXPECT_EQ(*ReadFile(Path("a")), "two");
  EXPECT_THAT(*ListFiles(folder_.path()), ElementsAre("a"));  // no temporary left
  EXPECT_EQ(*ReadFileRange(Path("a"), 1, 10), "wo");
  EXPECT_EQ(ReadFile(Path("a"), 2).status().code(), absl::StatusCode::kResourceExhausted);
}

TEST_F(FilesTest, TemporaryNamesAreUniqueAndInTheSameFolder) {
  std::set<std::string> names;
  for (int i = 0; i < 1000; ++i) names.insert(TemporaryBeside("/f/a"));
  EXPECT_EQ(names.size(), 1000u);
  EXPECT_THAT(*names.begin(), testing::MatchesRegex("/f/a\\.tmp-[0-9a-f]+"));
  EXPECT_EQ(UniqueName().size(), 32u);
  ASSERT_TRUE(WriteFileAtomic(Path("a"), "one").ok());
  ASSERT_TRUE(WriteFileAtomic(Path("b"), "two").ok());
  EXPECT_FALSE(CopyFileDurably(Path("a"), Path("b")).ok()) << "an existing file is not replaced";
  EXPECT_EQ(*ReadFile(Path("b")), "two");
}

TEST_F(FilesTest, ErrorsNameThePath) {
  const auto missing = ReadFile(Path("none"));
  EXPECT_EQ(missing.status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(missing.status().message()), HasSubstr(Path("none")));
  EXPECT_FALSE(WriteFileAtomic(Path("no/folder"), "x").ok());
  EXPECT_FALSE(ReadFile(folder_.path()).ok());
  EXPECT_FALSE(ListFiles(Path("none")).ok());
}

TEST_F(FilesTest, ListsRelativeAndSorted) {
  ASSERT_TRUE(EnsureFolder(Path("b/c")).ok());
  std::ofstream(Path("b/c/2")) << "x";
  std::ofstream(Path("b/1")) << "x";
  std::ofstream(Path("a")) << "x";
  EXPECT_THAT(*ListFiles(folder_.path()), ElementsAre("a", "b/1", "b/c/2"));
  ASSERT_TRUE(RemoveTree(Path("b")).ok());
  EXPECT_THAT(*ListFiles(folder_.path()), ElementsAre("a"));
  EXPECT_TRUE(RemoveTree(Path("b")).ok());
}

TEST_F(FilesTest, JoinInsideKeepsNamesInTheFolder) {
  EXPECT_EQ(*JoinInside("/f", "a/b.ply"), "/f/a/b.ply");
  for (const char* name : {"", "/etc/passwd", "../x", "a/../../x", "a/", "./a", "a//", ".."}) {
    EXPECT_FALSE(JoinInside("/f", name).ok()) << name;
  }
}

TEST_F(FilesTest, PrivateFolderAndItsContentLosePermissionsOfOthers) {
  const auto mode = [&](const std::string& name) {
    return static_cast<unsigned>(std::filesystem::status(Path(name)).permissions());
  };
  std::filesystem::create_directories(Path("p/q"));
  std::ofstream(Path("p/q/file")) << "x";
  std::ofstream(Path("outside")) << "x";
  std::filesystem::create_symlink(Path("outside"), Path("p/link"));
  std::filesystem::create_symlink(Path("none"), Path("p/dangling"));
  for (const char* name : {"p", "p/q"}) std::filesystem::permissions(Path(name), std::filesystem::perms(0755));
  for (const char* name : {"p/q/file", "outside"}) {
    std::filesystem::permissions(Path(name), std::filesystem::perms(0664));
  }
  ASSERT_TRUE(EnsurePrivateFolder(Path("p")).ok());
  EXPECT_EQ(mode("p"), 0700u);
  EXPECT_EQ(mode("p/q"), 0700u);
  EXPECT_EQ(mode("p/q/file"), 0600u);
  EXPECT_EQ(mode("outside"), 0664u) << "links are not followed";
  ASSERT_TRUE(EnsurePrivateFolder(Path("new/folder")).ok());
  EXPECT_EQ(mode("new/folder"), 0700u);
}

TEST_F(FilesTest, TempFolderIsRemoved) {
  std::string path;
  {
    auto inner = TempFolder::Create(Path("new"));
    ASSERT_TRUE(inner.ok());
    path = inner->path();
    std::ofstream(path + "/x") << "x";
    EXPECT_TRUE(std::filesystem::is_directory(path));
  }
  EXPECT_FALSE(std::filesystem::exists(path));
}

TEST_F(FilesTest, LockIsExclusive) {
  {
    auto lock = FileLock::Acquire(Path("lock"));
    ASSERT_TRUE(lock.ok());
    EXPECT_EQ(FileLock::Acquire(Path("lock")).status().code(), absl::StatusCode::kFailedPrecondition);
  }
  EXPECT_TRUE(FileLock::Acquire(Path("lock")).ok());
}

}  // namespace
}  // namespace tessera
