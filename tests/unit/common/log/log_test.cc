#include "common/log/log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace tessera {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::MatchesRegex;

// Characters that would start a line, end a value, or control the terminal.
const std::string kHostile = "host\n2026-11-23T03:35:06.123Z info job deleted job=jobs/1 \x1b[2J\xC2\x9B\" user=root";

TEST(LogLine, IsAlwaysOneLine) {
  const LogFields fields = {{"job", "jobs/3"}, {"worker", "workers/1-2"}, {"host", kHostile}, {"empty", ""}};
  EXPECT_EQ(LogLine("worker registered", fields, /*json=*/false),
            R"(worker registered job=jobs/3 worker=workers/1-2 host="host\n2026-11-23T03:35:06.123Z info job deleted )"
            R"(job=jobs/1 \u001b[2J\u009b\" user=root" empty="")");
  std::string line = "{";
  line.append(LogLine(kHostile, fields, /*json=*/true)).append("}");
  EXPECT_THAT(line, testing::Not(testing::ContainsRegex("[\n\x1b]")));
  const json parsed = json::parse(line);
  EXPECT_EQ(parsed["message"], kHostile);
  EXPECT_EQ(parsed["job"], "jobs/3");
  EXPECT_EQ(parsed["host"], kHostile);
  EXPECT_EQ(parsed.size(), 1 + fields.size());
}

TEST(LogLine, QuotesAmbiguousValues) {
  for (const char* value : {"a b", "a=b", "a\"b", "a\\b", "a\tb", "\xFF", "\u202e"}) {
    EXPECT_THAT(LogLine("event", {{"key", value}}, false), HasSubstr("key=\"")) << value;
  }
  EXPECT_EQ(LogLine("event", {{"key", "jobs/1/tasks/2:ü"}}, false), "event key=jobs/1/tasks/2:ü");
}

TEST(LogLine, CutsLongValues) {
  const std::string line = LogLine("event", {{"error", std::string(1 << 20, 'x')}}, false);
  EXPECT_LT(line.size(), 20'000u);
  EXPECT_THAT(line, HasSubstr("... and 1032192 more bytes"));
}

// The output schema of both formats.
TEST(Log, TextAndJsonHaveTheSameSchema) {
  testing::internal::CaptureStderr();
  ASSERT_TRUE(SetUpLog("info", /*json=*/false).ok());
  LogDebug("not this");
  LogWarning("attempt failed", {{"task", "jobs/1/tasks/2"}, {"host", kHostile}});
  const std::string text = testing::internal::GetCapturedStderr();
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1) << text;
  EXPECT_THAT(text.substr(0, 24), MatchesRegex("[0-9-]+T[0-9:]+\\.[0-9]+Z"));
  EXPECT_THAT(text.substr(24), testing::StartsWith(" warning attempt failed task=jobs/1/tasks/2 host=\"host\\n"));

  testing::internal::CaptureStderr();
  ASSERT_TRUE(SetUpLog("error", /*json=*/true).ok());
  LogWarning("not this");
  LogError("attempt failed", {{"task", "jobs/1/tasks/2"}});
  const json line = json::parse(testing::internal::GetCapturedStderr());
  EXPECT_EQ(line.size(), 4u);
  EXPECT_THAT(line["time"].get<std::string>(), MatchesRegex("[0-9-]+T[0-9:]+\\.[0-9]+Z"));
  EXPECT_EQ(line["level"], "error");
  EXPECT_EQ(line["message"], "attempt failed");
  EXPECT_EQ(line["task"], "jobs/1/tasks/2");
}

TEST(Log, RejectsUnknownLevels) {
  EXPECT_THAT(std::string(SetUpLog("loud", false).message()), HasSubstr("found 'loud', expected debug, info, warn"));
}

}  // namespace
}  // namespace tessera
