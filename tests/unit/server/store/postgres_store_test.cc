// What is PostgreSQL's alone: schemas, versions, waiting for the right to write, messages without passwords.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/store/postgres_schema.h"
#include "server/store/state_store.h"
#include "tests/support/servers/postgres_database.h"
#include "tests/unit/server/store/state_fixture.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

class PostgresStoreTest : public testing::Test {
 protected:
  void SetUp() override {
    TESSERA_NEED_SERVER("postgres");
    database_ = std::make_unique<PostgresDatabase>();
  }
  static std::string ErrorOf(const std::string& url) {
    const auto store = OpenState(url, {.holder = "test"});
    EXPECT_FALSE(store.ok());
    return store.status().ToString();
  }

  std::unique_ptr<PostgresDatabase> database_;
};

TEST_F(PostgresStoreTest, RefusesOtherProgramsAndNewerVersions) {
  const std::string& schema = database_->schema();
  database_->Run("CREATE SCHEMA " + schema + "; CREATE TABLE " + schema + ".customers (x INTEGER)");
  EXPECT_THAT(ErrorOf(database_->url()), AllOf(HasSubstr("FAILED_PRECONDITION"), HasSubstr("customers")));
  EXPECT_THAT(database_->Run("SELECT relname FROM pg_class WHERE relnamespace = '" + schema + "'::regnamespace"),
              ElementsAre("customers"))
      << "nothing is created in it";
  database_->Run("DROP TABLE customers");
  ASSERT_TRUE(OpenState(database_->url(), {.holder = "test"}).ok()) << "an existing, empty schema";
  database_->Run("UPDATE tessera_version SET version = 99");
  EXPECT_THAT(ErrorOf(database_->url()), AllOf(HasSubstr("FAILED_PRECONDITION"), HasSubstr("schema version 99, exp")));
}

TEST_F(PostgresStoreTest, SchemasSeparateCoordinators) {
  const PostgresDatabase other;
  auto store = *OpenState(database_->url(), {.holder = "one"});
  auto other_store = *OpenState(other.url(), {.holder = "two"});
  ASSERT_TRUE(store->Append({"one"}, Durability::kMachine).ok());
  ASSERT_TRUE(other_store->Append({"two"}, Durability::kMachine).ok());
  EXPECT_THAT(AllRecords(*store), ElementsAre("one"));
  EXPECT_THAT(AllRecords(*other_store), ElementsAre("two"));
  EXPECT_THAT(store->Location(), HasSubstr("schema " + database_->schema()));
}

TEST_F(PostgresStoreTest, SeveralProcessesMayCreateTheTables) {
  const PostgresTarget target = *ParsePostgresUrl(database_->url());
  std::vector<std::thread> threads;
  std::vector<Status> statuses(6);
  for (Status& status : statuses) {
    threads.emplace_back([&] {
      PostgresTarget own = target;
      status = PreparePostgresSchema(own);
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const Status& status : statuses) EXPECT_TRUE(status.ok()) << status;
}

TEST_F(PostgresStoreTest, StandbyWaitsAndTakesOver) {
  auto active = *OpenState(database_->url(), {.holder = "the active one"});
  OpenStateOptions options;
  options.holder = "standby";
  int looks = 0;
  options.wait = [&](const std::string& holder, double renewed_before_s) {
    EXPECT_EQ(holder, looks < 2 ? "the active one" : "");
    EXPECT_GE(renewed_before_s, 0);
    return ++looks < 2;
  };
  EXPECT_EQ(OpenState(database_->url(), options).status().code(), absl::StatusCode::kCancelled);
  options.wait = [&](const std::string&, double) {
    active->Release();
    return true;
  };
  const auto standby = OpenState(database_->url(), options);
  ASSERT_TRUE(standby.ok()) << standby.status();
  EXPECT_GT((*standby)->StartCount(), active->StartCount());
}

// Also if a dump of an earlier time was restored: its epoch would be raised to one that was in use since.
TEST_F(PostgresStoreTest, StartCountsRiseAfterARestoredDump) {
  const auto starts = [&] { return (*OpenState(database_->url(), {.holder = "test"}))->StartCount(); };
  const int64_t dumped = starts(), later = starts();
  database_->Run("UPDATE coordinator SET epoch = " + std::to_string(dumped));
  EXPECT_GT(starts(), later);
}

TEST_F(PostgresStoreTest, KeptValuesCanBeReadByOthers) {
  EXPECT_EQ(*ReadKept(database_->url(), "name"), std::nullopt) << "there is no state yet";
  const auto store = *OpenState(database_->url(), {.holder = "test"});
  EXPECT_EQ(*ReadKept(database_->url(), "name"), std::nullopt);
  ASSERT_TRUE(store->Replace("name", "first").ok());
  EXPECT_EQ(*store->Keep("name", "second"), "first");
  ASSERT_TRUE(store->Replace("name", "third").ok());
  EXPECT_EQ(*ReadKept(database_->url(), "name"), "third");
}

TEST(PostgresUrlTest, PasswordsAreInNoMessage) {
  const std::vector<std::string> urls = {
      "postgresql://user:s3cret@127.0.0.1:1/database",
      "postgresql://user:s3cret@127.0.0.1:port/database",
      "postgresql://user:x@s3cret@127.0.0.1:1/database",
      "postgresql://user:x/s3cret@127.0.0.1:1/database",
      "postgresql://user:x%s3cret@127.0.0.1:1/database",
      "postgresql://user:x?s3cret@127.0.0.1:1/database",
      "postgresql://user@127.0.0.1:1/database?password=s3cret",
      "postgresql://user@127.0.0.1:1/database?passwort=s3cret",
      "postgresql://user@127.0.0.1:1/database?sslpassword=s3cret",
  };
  for (const std::string& url : urls) {
    const auto store = OpenState(url, {.holder = "test"});
    EXPECT_THAT(store.status().ToString(), Not(HasSubstr("s3cret"))) << url;
    EXPECT_THAT(store.status().ToString(), Not(HasSubstr("OK"))) << url;
  }
  EXPECT_TRUE(HasPassword(urls[0]));
  EXPECT_TRUE(HasPassword(urls[6]));
  EXPECT_TRUE(HasPassword(urls[8]));
  EXPECT_FALSE(HasPassword("postgresql://user@127.0.0.1/database"));
  EXPECT_FALSE(HasPassword("/data/password=x"));
}

}  // namespace
}  // namespace tessera
