// Lost answers, lost connections, and a server that is killed, restarted or read-only.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "common/storage/files.h"
#include "server/store/state_store.h"
#include "tests/e2e/tcp_proxy.h"
#include "tests/support/servers/postgres_database.h"
#include "tests/unit/server/store/state_fixture.h"

namespace tessera {
namespace {

using e2e::TcpProxy;
using testing::ElementsAre;
using testing::ElementsAreArray;

void Pause() { std::this_thread::sleep_for(std::chrono::milliseconds(20)); }

// As the journal does.
Status AppendUntilStored(StateStore& store, const std::vector<std::string_view>& records, Durability durability) {
  while (true) {
    const Status status = store.Append(records, durability);
    if (!absl::IsUnavailable(status)) return status;
    Pause();
  }
}

// The store's connections go through a proxy.
class LostConnectionTest : public testing::Test {
 protected:
  void SetUp() override {
    TESSERA_NEED_SERVER("postgres");
    const std::string server = ServerAddress("postgres");  // postgresql://USER@HOST:PORT/DATABASE
    const size_t host = server.find('@') + 1, path = server.find('/', host);
    database_ = std::make_unique<PostgresDatabase>();
    proxy_ = std::make_unique<TcpProxy>(server.substr(host, path - host));
    proxied_ = database_->UrlAt(server.substr(0, host) + proxy_->address() + server.substr(path));
  }
  // Until the statement's first column is `value`.
  void AwaitValue(const std::string& sql, const std::string& value) {
    while (database_->Run(sql).front() != value) Pause();
  }

  std::unique_ptr<PostgresDatabase> database_;
  std::unique_ptr<TcpProxy> proxy_;
  std::string proxied_;
};

TEST_F(LostConnectionTest, RepeatedBatchIsStoredOnce) {
  const auto store = *OpenState(proxied_, {.holder = "test"});
  ASSERT_TRUE(store->Append({"one"}, Durability::kMachine).ok());
  proxy_->Set(TcpProxy::Mode::kNoAnswers);
  auto lost = std::async(std::launch::async, [&] { return store->Append({"two", "three"}, Durability::kMachine); });
  AwaitValue("SELECT count(*) FROM records", "3");
  proxy_->Drop();
  EXPECT_TRUE(absl::IsUnavailable(lost.get())) << "the answer was lost";
  proxy_->Set(TcpProxy::Mode::kPass);
  EXPECT_TRUE(AppendUntilStored(*store, {"two", "three"}, Durability::kMachine).ok());
  EXPECT_TRUE(store->Append({"four"}, Durability::kMachine).ok());
  EXPECT_THAT(AllRecords(*store), ElementsAre("one", "two", "three", "four"));
}

TEST_F(LostConnectionTest, OtherRecordsInPlaceOfItsOwnEndAStore) {
  const auto store = *OpenState(proxied_, {.holder = "test"});
  ASSERT_TRUE(store->Append({"one"}, Durability::kMachine).ok());
  database_->Run("INSERT INTO records VALUES (2, 'other', 0, -1)");
  const Status status = store->Append({"two"}, Durability::kMachine);
  EXPECT_TRUE(IsTakenOver(status)) << status;
}

// Longer than a lease: another coordinator takes over, and the one that was cut off writes nothing more.
TEST_F(LostConnectionTest, CutOffHolderIsReplaced) {
  const auto store = *OpenState(proxied_, {.holder = "cut off"});
  ASSERT_TRUE(store->Append({"one"}, Durability::kMachine).ok());
  EXPECT_GT(store->HeldFor_s(), 0);
  proxy_->Set(TcpProxy::Mode::kStall);
  OpenStateOptions options;
  options.holder = "next";
  options.wait = [](const std::string&, double) { return true; };
  const auto next = OpenState(database_->url(), options);
  ASSERT_TRUE(next.ok()) << next.status();
  EXPECT_LE(store->HeldFor_s(), 0) << "it knew before the lease was free";
  ASSERT_TRUE((*next)->Append({"two"}, Durability::kMachine).ok());
  proxy_->Set(TcpProxy::Mode::kPass);
  EXPECT_TRUE(IsTakenOver(AppendUntilStored(*store, {"three"}, Durability::kMachine)));
  EXPECT_THAT(AllRecords(**next), ElementsAre("one", "two"));
}

// A statement of the holder that arrives after the takeover.
TEST_F(LostConnectionTest, EveryWriteOfAnOldEpochIsRefused) {
  const auto store = *OpenState(database_->url(), {.holder = "test"});
  ASSERT_TRUE(store->Append({"one", "two"}, Durability::kMachine).ok());
  const auto raise = [&] { database_->Run("UPDATE coordinator SET epoch = epoch + 1"); };
  const std::vector<std::function<Status(StateStore&)>> writes = {
      [](StateStore& s) { return s.Append({"three"}, Durability::kProcess); },
      [](StateStore& s) { return s.Quarantine(1, "reason"); },
      [](StateStore& s) { return s.RemoveRecords(1).status(); },
      [](StateStore& s) { return s.Keep("name", "value").status(); },
      [](StateStore& s) { return s.Replace("name", "value"); },
      [](StateStore& s) { return s.WorkerKey().status(); },
      [](StateStore& s) {
        return s.Remember("/x", {7, 1}, {std::string(64, 'a'), 7});
      },
  };
  database_->Run("INSERT INTO deleted_jobs VALUES (-1)");  // so that RemoveRecords has something to remove
  const std::string contents =
      "SELECT count(*) || ' ' || (SELECT count(*) FROM set_aside) || ' ' || (SELECT count(*) FROM kept) || ' ' ||"
      " (SELECT count(*) FROM file_digests) || ' ' || (SELECT count(*) FROM removed) FROM records";
  const auto before = database_->Run(contents);
  store->Release();
  for (size_t i = 0; i < writes.size(); ++i) {
    const auto old = *OpenState(database_->url(), {.holder = "old"});
    raise();
    const Status status = writes[i](*old);
    EXPECT_FALSE(status.ok()) << "write " << i;
    EXPECT_EQ(database_->Run(contents), before) << "write " << i;
    database_->Run("UPDATE coordinator SET renewed = to_timestamp(0)");
  }
  const PostgresDatabase empty;
  const auto old = *OpenState(empty.url(), {.holder = "old"});
  const auto fill = [&](const RowSink& add) {
    empty.Run("UPDATE coordinator SET epoch = epoch + 1");
    return add(StateTables()[0], {"1", "content", "0", "-1"});
  };
  EXPECT_FALSE(old->Import(fill, 1).ok());
  EXPECT_THAT(empty.Run("SELECT count(*) FROM records"), ElementsAre("0"));
}

// Otherwise its records could be stored after the new coordinator has read the last one.
TEST_F(LostConnectionTest, TakeoverWaitsForABatchInProgress) {
  const auto store = *OpenState(database_->url(), {.holder = "test"});
  const PostgresTarget target = *ParsePostgresUrl(database_->url());
  const auto blocker = *PostgresConnection::Open(target, 30), taker = *PostgresConnection::Open(target, 30);
  const std::string pid = blocker->Run("SELECT pg_backend_pid()")->Text(0, 0);
  ASSERT_TRUE(blocker->Run("BEGIN; INSERT INTO records VALUES (1, 'same number', 0, -1)").ok());
  auto batch = std::async(std::launch::async, [&] { return store->Append({"one"}, Durability::kMachine); });
  AwaitValue("SELECT count(*) FROM pg_stat_activity WHERE " + pid + " = ANY(pg_blocking_pids(pid))", "1");
  ASSERT_TRUE(taker->Run("SET lock_timeout = '100ms'").ok());
  EXPECT_FALSE(taker->Run("UPDATE coordinator SET epoch = epoch + 1").ok());
  EXPECT_EQ(taker->error_code(), "55P03") << "lock_not_available";
  ASSERT_TRUE(blocker->Run("ROLLBACK").ok());
  const Status stored = batch.get();
  EXPECT_TRUE(stored.ok()) << stored;
  EXPECT_TRUE(taker->Run("UPDATE coordinator SET epoch = epoch + 1").ok());
}

// A server of its own, that may be killed.
class FaultyServerTest : public testing::Test {
 protected:
  void SetUp() override {
    TESSERA_NEED_SERVER("postgres");
    // Without the writer that would write out what was not synced, within .2 s.
    ::setenv("PG_OPTIONS", "-c wal_writer_delay=10s", 1);
    Server("start");
    std::ifstream(folder_.path() + "/address") >> url_;
    ASSERT_FALSE(url_.empty());
  }
  void TearDown() override {
    if (!url_.empty()) Server("stop");
  }
  void Server(const std::string& action) {
    ASSERT_EQ(std::system((std::string(TESSERA_START_POSTGRES) + " " + folder_.path() + " " + action).c_str()), 0);
  }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  std::string url_;
};

TEST_F(FaultyServerTest, NothingIsLostWhileTheServerFails) {
  const auto store = *OpenState(url_, {.holder = "test"});
  std::vector<std::string> records;
  const auto append = [&](Durability durability) {
    records.push_back("record " + std::to_string(records.size()));
    const Status status = AppendUntilStored(*store, {records.back()}, durability);
    ASSERT_TRUE(status.ok()) << status;
  };
  append(Durability::kMachine);
  // Killed: what it had acknowledged without a sync is lost, and is stored again.
  append(Durability::kProcess);
  append(Durability::kProcess);
  Server("kill");
  Server("again");
  ASSERT_EQ(RunPostgres(url_, "SELECT max(id) FROM records"), std::vector<std::string>{"1"}) << "nothing is shown";
  append(Durability::kProcess);
  append(Durability::kMachine);
  // Read-only, also for connections that are open.
  RunPostgres(url_, "ALTER SYSTEM SET default_transaction_read_only = on");
  RunPostgres(url_, "SELECT pg_reload_conf()");
  while (store->Append({"refused"}, Durability::kMachine).ok()) {
    records.emplace_back("refused");  // the server has not read its configuration yet
    Pause();
  }
  EXPECT_TRUE(absl::IsUnavailable(store->Append({"refused"}, Durability::kMachine)));
  RunPostgres(url_ + "?target_session_attrs=any", "ALTER SYSTEM RESET default_transaction_read_only");
  RunPostgres(url_ + "?target_session_attrs=any", "SELECT pg_reload_conf()");
  append(Durability::kProcess);
  append(Durability::kMachine);
  EXPECT_THAT(AllRecords(*store), ElementsAreArray(records));
  EXPECT_TRUE(store->Quarantine(1, "reason").ok());
}

}  // namespace
}  // namespace tessera
