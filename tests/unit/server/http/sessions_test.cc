#include "server/http/sessions.h"

#include <gtest/gtest.h>

#include <string>

namespace tessera {
namespace {

using Clock = Sessions::Clock;

TEST(Sessions, EndByLogOutAndByIdleness) {
  Sessions sessions;
  const Clock::time_point start = Clock::now();
  const std::string id = sessions.Begin("token", start), other = sessions.Begin("token", start);
  EXPECT_NE(id, other);
  EXPECT_GE(id.size(), 43u);
  EXPECT_EQ(sessions.TokenOf(id, start), "token");
  EXPECT_FALSE(sessions.TokenOf(id + "x", start).has_value());
  EXPECT_FALSE(sessions.TokenOf("", start).has_value());
  sessions.End(id);
  EXPECT_FALSE(sessions.TokenOf(id, start).has_value());
  EXPECT_TRUE(sessions.TokenOf(other, start + Sessions::kIdle).has_value());
  EXPECT_TRUE(sessions.TokenOf(other, start + 2 * Sessions::kIdle).has_value()) << "it was used meanwhile";
  EXPECT_FALSE(sessions.TokenOf(other, start + 3 * Sessions::kIdle + std::chrono::seconds(1)).has_value());
  EXPECT_EQ(sessions.size(), 0u);
}

TEST(Sessions, AreBounded) {
  Sessions sessions;
  const Clock::time_point now = Clock::now();
  const std::string quiet = sessions.Begin("another", now);
  const std::string first = sessions.Begin("token", now);
  for (size_t i = 0; i < Sessions::kMaxOfToken; ++i) sessions.Begin("token", now);
  EXPECT_FALSE(sessions.TokenOf(first, now).has_value()) << "a token has too many";
  EXPECT_TRUE(sessions.TokenOf(quiet, now).has_value()) << "which is no other token's loss";
  for (size_t i = 0; i < Sessions::kMax + 10; ++i) sessions.Begin("token " + std::to_string(i), now);
  EXPECT_EQ(sessions.size(), Sessions::kMax);
}

TEST(GuessLimits, CountByAddressAndTellOnce) {
  using Verdict = GuessLimits::Verdict;
  GuessLimits limits;
  const auto now = GuessLimits::Clock::now();
  for (int i = 0; i < GuessLimits::kMaxFailures; ++i) EXPECT_EQ(limits.Failed("a", now), Verdict::kUnknown);
  EXPECT_EQ(limits.Failed("a", now), Verdict::kFirstTooMany);
  for (int i = 0; i < 1000; ++i) EXPECT_EQ(limits.Failed("a", now), Verdict::kTooMany);
  EXPECT_EQ(limits.Failed("b", now), Verdict::kUnknown);
  EXPECT_EQ(limits.Failed("a", now + GuessLimits::kWindow + std::chrono::seconds(1)), Verdict::kUnknown);
  for (int i = 0; i < 10'000; ++i) limits.Failed("address " + std::to_string(i), now);
  EXPECT_EQ(limits.Failed("one more", now), Verdict::kTooMany) << "the table is full";
}

}  // namespace
}  // namespace tessera
