// Two coordinators take a state over from each other, and the one that loses it is stopped in the middle of its work.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "common/storage/files.h"
#include "server/store/state_store.h"
#include "tests/support/servers/postgres_database.h"

namespace tessera {
namespace {

constexpr char kFiller = '.';

// Appends batches until the state is taken over, again and again. Writes the number of each record to `acknowledged`
// once it is stored: "EPOCH NUMBER", the beginning of the record.
[[noreturn]] void WriteForEver(const std::string& url, const std::string& name, const std::string& acknowledged) {
  const int log = ::open(acknowledged.c_str(), O_CREAT | O_WRONLY | O_APPEND | O_CLOEXEC, 0600);
  std::mt19937 random(static_cast<unsigned>(::getpid()));
  OpenStateOptions options;
  options.holder = name;
  options.wait = [](const std::string&, double) { return true; };
  while (true) {
    auto store = OpenState(url, options);
    if (!store.ok()) _exit(1);
    for (int number = 0;;) {
      std::vector<std::string> records(random() % 10 == 0 ? 1000 : 1 + random() % 20), names;
      for (std::string& record : records) {
        names.push_back(std::to_string((*store)->StartCount()) + " " + std::to_string(++number));
        record = names.back() + std::string(random() % 500, kFiller);
      }
      const std::vector<std::string_view> batch(records.begin(), records.end());
      const auto durability = random() % 2 == 0 ? Durability::kMachine : Durability::kProcess;
      Status status = (*store)->Append(batch, durability);
      while (absl::IsUnavailable(status)) status = (*store)->Append(batch, durability);
      if (IsTakenOver(status)) break;
      if (!status.ok()) _exit(2);
      std::string lines;
      for (const std::string& stored : names) lines += stored + "\n";
      if (::write(log, lines.data(), lines.size()) != static_cast<ssize_t>(lines.size())) _exit(3);
    }
  }
}

TEST(OneWriterTest, NoRecordOfAnOldEpochAfterATakeover) {
  TESSERA_NEED_SERVER("postgres");
  const char* const wanted = std::getenv("TESSERA_TAKEOVERS");  // by hand: 1000
  const int takeovers = wanted != nullptr ? std::atoi(wanted) : 8;
  const TempFolder folder = *TempFolder::Create(testing::TempDir());
  const PostgresDatabase database;
  ASSERT_TRUE(OpenState(database.url(), {.holder = "first"}).ok());
  pid_t writers[2] = {};
  for (int i = 0; i < 2; ++i) {
    writers[i] = ::fork();
    if (writers[i] == 0) {
      WriteForEver(database.url(), std::to_string(i), folder.path() + "/acknowledged-" + std::to_string(i));
    }
  }
  const PostgresTarget target = *ParsePostgresUrl(database.url());
  const auto connection = *PostgresConnection::Open(target, 30);
  // Who has the lease and has stored a record since.
  const auto active = [&] {
    while (true) {
      const auto rows = *connection->Run(
          "SELECT holder FROM coordinator WHERE holder <> '' AND EXISTS (SELECT 1 FROM records WHERE id = (SELECT"
          " max(id) FROM records) AND convert_from(content, 'UTF8') LIKE epoch || ' %')");
      if (rows.size() == 1 && rows.Text(0, 0).size() == 1) return std::stoi(rows.Text(0, 0));
      ::usleep(1000);
    }
  };
  std::mt19937 random(1);
  for (int i = 0; i < takeovers; ++i) {
    const int holder = active();
    ::usleep(random() % 30'000);
    ::kill(writers[holder], SIGSTOP);
    int state = 0;
    ASSERT_EQ(::waitpid(writers[holder], &state, WUNTRACED), writers[holder]);
    ASSERT_TRUE(WIFSTOPPED(state)) << "a writer has ended with " << WEXITSTATUS(state);
    // As if 6 s had passed. A lock of the stopped process would let this fail.
    while (true) {
      const auto expired = connection->Run("UPDATE coordinator SET renewed = to_timestamp(0) WHERE holder = '" +
                                           std::to_string(holder) + "' RETURNING 1");
      ASSERT_TRUE(expired.ok()) << expired.status();
      if (expired->size() == 0) break;
      ::usleep(5000);
    }
    ASSERT_EQ(active(), 1 - holder);
    ::kill(writers[holder], SIGCONT);
  }
  for (const pid_t writer : writers) {
    ::kill(writer, SIGKILL);
    ::waitpid(writer, nullptr, 0);
  }
  connection->Run("UPDATE coordinator SET renewed = to_timestamp(0)").IgnoreError();
  const auto store = OpenState(database.url(), {.holder = "last"});
  ASSERT_TRUE(store.ok()) << store.status();
  std::set<std::string> stored;
  std::set<int64_t> epochs;
  int64_t epoch = 0, number = 0;
  ASSERT_TRUE((*store)
                  ->Replay([&](const StoredRecord& record) {
                    ASSERT_TRUE(record.content.ok()) << record.content.status();
                    const std::string name = record.content->substr(0, record.content->find(kFiller));
                    EXPECT_TRUE(stored.insert(name).second) << name << " is stored twice";
                    const int64_t own = std::stoll(name);
                    EXPECT_GE(own, epoch) << "an old coordinator has written after a new one";
                    number = own == epoch ? number + 1 : 1;
                    EXPECT_EQ(name, std::to_string(own) + " " + std::to_string(number)) << "out of order";
                    epochs.insert(epoch = own);
                  })
                  .ok());
  EXPECT_GT(epochs.size(), static_cast<size_t>(takeovers));
  size_t acknowledged = 0;
  for (int i = 0; i < 2; ++i) {
    std::ifstream log(folder.path() + "/acknowledged-" + std::to_string(i));
    for (std::string name; std::getline(log, name); ++acknowledged) {
      ASSERT_TRUE(stored.contains(name)) << name << " was acknowledged and is lost";
    }
  }
  EXPECT_GT(acknowledged, 0u);
  std::printf("%d takeovers, %zu records, %zu acknowledged\n", takeovers, stored.size(), acknowledged);
}

}  // namespace
}  // namespace tessera
