// Ranges, ETags and archives of sheets.
#include "common/storage/files.h"

#include <gtest/gtest.h>

#include <string>

#include "common/storage/zip_writer.h"
#include "server/http/job_files.h"
#include "server/http/stored_zip.h"

namespace tessera {
namespace {

using Range = std::pair<int64_t, int64_t>;

TEST(RangeOf, TakesOnePart) {
  EXPECT_EQ(*RangeOf("", 100), Range(0, 99));
  EXPECT_EQ(*RangeOf("bytes=0-0", 100), Range(0, 0));
  EXPECT_EQ(*RangeOf("bytes=10-", 100), Range(10, 99));
  EXPECT_EQ(*RangeOf("bytes=10-1000", 100), Range(10, 99));
  EXPECT_EQ(*RangeOf("bytes=-10", 100), Range(90, 99));
  EXPECT_EQ(*RangeOf("bytes=-1000", 100), Range(0, 99));
  for (const char* const ignored : {"bytes=", "bytes=-", "bytes=5-4", "bytes=1-2,3-4", "lines=1-2", "bytes=a-b",
                                    "bytes=--1", "bytes=1-99999999999999999999", "bytes= 1-2"}) {
    EXPECT_EQ(*RangeOf(ignored, 100), Range(0, 99)) << ignored;
  }
  for (const char* const outside : {"bytes=100-", "bytes=100-200", "bytes=-0"}) {
    EXPECT_EQ(RangeOf(outside, 100).status().code(), absl::StatusCode::kOutOfRange) << outside;
  }
  EXPECT_EQ(*RangeOf("", 0), Range(0, -1));
  EXPECT_FALSE(RangeOf("bytes=0-", 0).ok());
}

TEST(HasEtag, ReadsLists) {
  EXPECT_TRUE(HasEtag("\"a\"", "a"));
  EXPECT_TRUE(HasEtag("\"b\", W/\"a\"", "a"));
  EXPECT_TRUE(HasEtag("*", "a"));
  EXPECT_FALSE(HasEtag("", "a"));
  EXPECT_FALSE(HasEtag("a", "a"));
  EXPECT_FALSE(HasEtag("\"ab\"", "a"));
}

class StoredZipTest : public testing::Test {
 protected:
  StoredZipTest() {
    const std::string in = folder_.path() + "/in";
    EXPECT_TRUE(EnsureFolder(in + "/result/3_-1").ok());
    for (const auto& [name, content] : contents_) EXPECT_TRUE(WriteFileAtomic(in + "/" + name, content).ok());
    std::vector<std::string> names;
    for (const auto& [name, content] : contents_) names.push_back(name);
    EXPECT_TRUE(WriteStoredZip(folder_.path() + "/a.zip", in, names).ok());
    archive_ = *ReadFile(folder_.path() + "/a.zip", 1 << 30);
  }
  static StatusOr<ZipDirectory> Directory(const std::string& archive) {
    return ReadZipDirectory(static_cast<int64_t>(archive.size()), [&](int64_t offset, int64_t size) {
      return StatusOr<std::string>(archive.substr(static_cast<size_t>(offset), static_cast<size_t>(size)));
    });
  }

  const std::map<std::string, std::string> contents_ = {{"result/3_-1/0.glb", std::string(300'000, 'g')},
                                                        {"result/3_-1/1.glb", ""},
                                                        {"result/3_-1/tileset.json", "{\"asset\":{}}"}};
  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  std::string archive_;
};

TEST_F(StoredZipTest, FindsTheContentOfEachMember) {
  const auto directory = Directory(archive_);
  ASSERT_TRUE(directory.ok()) << directory.status();
  ASSERT_EQ(directory->size(), contents_.size());
  for (const auto& [name, content] : contents_) {
    const ZipMember& member = directory->at(name);
    EXPECT_EQ(archive_.substr(static_cast<size_t>(member.offset_bytes), static_cast<size_t>(member.size_bytes)),
              content)
        << name;
  }
}

TEST_F(StoredZipTest, DamageIsFoundOrLeavesRangesInside) {
  EXPECT_FALSE(Directory("").ok());
  EXPECT_FALSE(Directory("PK\x05\x06").ok());
  EXPECT_FALSE(Directory(archive_.substr(0, archive_.size() - 30)).ok());
  for (size_t i = archive_.size() - 300; i < archive_.size(); ++i) {
    for (const int flip : {1, 0x80, 0xff}) {
      std::string damaged = archive_;
      damaged[i] = static_cast<char>(damaged[i] ^ flip);
      const auto directory = Directory(damaged);
      if (!directory.ok()) continue;
      for (const auto& [name, member] : *directory) {
        EXPECT_GE(member.offset_bytes, 0);
        EXPECT_LE(member.offset_bytes + member.size_bytes, static_cast<int64_t>(archive_.size()));
      }
    }
  }
}

}  // namespace
}  // namespace tessera
