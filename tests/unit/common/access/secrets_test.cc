#include "common/access/secrets.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>
#include <set>

#include "common/storage/files.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class Secrets : public testing::Test {
 protected:
  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  std::string path_ = folder_.path() + "/secret";
};

TEST_F(Secrets, RandomSecretsDiffer) {
  std::set<std::string> seen;
  for (int i = 0; i < 100; ++i) seen.insert(RandomSecret());
  EXPECT_EQ(seen.size(), 100u);
  EXPECT_EQ(seen.begin()->size(), 43u);
}

TEST_F(Secrets, KeyedHashIsHmacSha256) {  // RFC 4231, test case 2
  EXPECT_EQ(KeyedHash("Jefe", "what do ya want for nothing?"),
            "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843");
  EXPECT_TRUE(SameSecret("abc", "abc"));
  EXPECT_FALSE(SameSecret("abc", "abd"));
  EXPECT_FALSE(SameSecret("abc", "ab"));
}

TEST_F(Secrets, EnsureSecretFileCreatesOnceWithMode600) {
  const auto made = EnsureSecretFile(path_);
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_EQ(*EnsureSecretFile(path_), *made);
  struct stat info;
  ASSERT_EQ(::stat(path_.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0600u);
}

TEST_F(Secrets, RejectsReadableOrMalformedFilesWithoutQuotingThem) {
  ASSERT_TRUE(WriteSecretFile(path_, "the-secret\nanother\n").ok());
  const Status two = ReadSecretFile(path_).status();
  EXPECT_EQ(two.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(two.message()), AllOf(HasSubstr(path_), Not(HasSubstr("the-secret"))));
  ASSERT_TRUE(WriteSecretFile(path_, "").ok());
  EXPECT_FALSE(ReadSecretFile(path_).ok());
  ASSERT_TRUE(WriteSecretFile(path_, "the-secret").ok());
  EXPECT_EQ(*ReadSecretFile(path_), "the-secret");
  ::chmod(path_.c_str(), 0644);
  EXPECT_EQ(ReadSecretFile(path_).status().code(), absl::StatusCode::kPermissionDenied);
}

}  // namespace
}  // namespace tessera
