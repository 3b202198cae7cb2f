#include "common/storage/zip_writer.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>

#include "common/storage/files.h"
#include "common/storage/zip_file.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

TEST(ZipWriterTest, ArchivesDependOnNamesAndContentsAlone) {
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  std::string archives[2];
  for (const int late : {0, 1}) {
    const std::string in = folder.path() + (late ? "/late" : "/early");
    ASSERT_TRUE(EnsureFolder(in + "/nodes").ok());
    ASSERT_TRUE(WriteFileAtomic(in + "/nodes/b.glb", std::string(5000, 'b')).ok());
    ASSERT_TRUE(WriteFileAtomic(in + "/a.json", "", late ? 0600 : 0644).ok());
    const auto time = fs::file_time_type::clock::now() - std::chrono::hours(late ? 0 : 50'000);
    fs::last_write_time(in + "/nodes/b.glb", time);
    const std::string path = folder.path() + "/" + std::to_string(late) + ".zip";
    const Status written = WriteStoredZip(path, in, {"a.json", "nodes/b.glb"});
    ASSERT_TRUE(written.ok()) << written;
    archives[late] = ReadFile(path).value();
  }
  EXPECT_EQ(archives[0], archives[1]);
  EXPECT_GT(archives[0].size(), 5000u) << "stored, not compressed";
  auto zip = ZipFile::Parse(archives[0], "archive");
  ASSERT_TRUE(zip.ok()) << zip.status();
  EXPECT_EQ(zip->members(), (std::vector<std::string>{"a.json", "nodes/b.glb"}));
  EXPECT_EQ(zip->Read("a.json", 10).value(), "");
  EXPECT_EQ(zip->Read("nodes/b.glb", 10'000).value(), std::string(5000, 'b'));
}

TEST(ZipWriterTest, NothingIsLeftAfterAnError) {
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  ASSERT_TRUE(WriteFileAtomic(folder.path() + "/a", "a").ok());
  EXPECT_FALSE(WriteStoredZip(folder.path() + "/out.zip", folder.path(), {"a", "missing"}).ok());
  EXPECT_EQ(ListFiles(folder.path()).value().size(), 1u) << "only the file itself";
}

}  // namespace
}  // namespace tessera
