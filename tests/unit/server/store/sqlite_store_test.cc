#include "server/store/sqlite_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "common/access/secrets.h"
#include "common/storage/files.h"
#include "tests/unit/server/store/state_fixture.h"

namespace tessera {
namespace {

using testing::HasSubstr;

class SqliteStoreTest : public testing::Test {
 protected:
  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  const std::string path_ = folder_.path() + "/state.sqlite";
};

TEST_F(SqliteStoreTest, RefusesOtherDatabases) {
  std::ofstream(path_) << std::string(5000, 'x');
  EXPECT_EQ(SqliteStore::Open(path_).status().code(), absl::StatusCode::kDataLoss);
  ASSERT_TRUE(RemoveTree(path_).ok());
  RunSqlite(path_, "CREATE TABLE other (x)");
  EXPECT_EQ(SqliteStore::Open(path_).status().code(), absl::StatusCode::kFailedPrecondition);
  ASSERT_TRUE(RemoveTree(path_).ok());
  ASSERT_TRUE(SqliteStore::Open(path_).ok());
  for (const std::string version : {"2", "99"}) {
    RunSqlite(path_, "PRAGMA user_version = " + version);
    const auto other = SqliteStore::Open(path_);
    EXPECT_THAT(std::string(other.status().message()), HasSubstr("schema version " + version + ", expected"));
  }
  EXPECT_FALSE(SqliteStore::Open(folder_.path() + "/none/x").ok());
}

// Earlier releases kept the key in a file.
TEST_F(SqliteStoreTest, TakesOverTheWorkerKeyOfEarlierReleases) {
  const std::string file = folder_.path() + "/worker.key";
  const std::string key = *EnsureSecretFile(file);
  EXPECT_EQ(*(*SqliteStore::Open(path_))->WorkerKey(), key);
  EXPECT_FALSE(FileExists(file));
  EXPECT_EQ(*(*SqliteStore::Open(path_))->WorkerKey(), key);
}

}  // namespace
}  // namespace tessera
