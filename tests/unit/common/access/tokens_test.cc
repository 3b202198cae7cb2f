#include "common/access/tokens.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/storage/hash.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

TEST(Tokens, FindComparesHashes) {
  TokenTable table;
  ASSERT_TRUE(table.Add({"anna", Role::kSubmitter, Sha256Hex("secret a"), 0}).ok());
  ASSERT_TRUE(table.Add({"rack-1", Role::kWorker, Sha256Hex("secret b"), 1'800'000'000'000'000}).ok());
  const auto read = TokenTable::Parse(table.ToText(), "tokens");
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_NE(read->Find("secret b"), nullptr);
  EXPECT_EQ(read->Find("secret b")->name, "rack-1");
  EXPECT_EQ(read->Find("secret b")->role, Role::kWorker);
  EXPECT_EQ(read->Find("secret b")->expires_us, 1'800'000'000'000'000);
  EXPECT_EQ(read->Find("secret a")->expires_us, 0);
  EXPECT_EQ(read->Find("secret c"), nullptr);
  EXPECT_EQ(read->Find(""), nullptr);
  EXPECT_EQ(read->Find(Sha256Hex("secret a")), nullptr) << "the hash is no token";
  EXPECT_TRUE(table.Remove("anna"));
  EXPECT_FALSE(table.Remove("anna"));
  EXPECT_EQ(table.Find("secret a"), nullptr);
}

TEST(Tokens, ParseReportsAllLinesWithErrorsWithoutQuotingThem) {
  const std::string hash = Sha256Hex("x");
  const auto table =
      TokenTable::Parse("# names\n\nanna submitter " + hash + " never\n" + "bob boss " + hash + " never\n" +
                            "the-token-itself\n" + "carl viewer the-token-itself never\n" + "anna viewer " + hash +
                            " never\n" + "dora viewer " + hash + " tomorrow\n" + "a/b viewer " + hash + " never\n",
                        "tokens");
  EXPECT_EQ(table.status().code(), absl::StatusCode::kInvalidArgument);
  const std::string faults(table.status().message());
  EXPECT_THAT(faults, AllOf(HasSubstr("line 4"), HasSubstr("line 5"), HasSubstr("line 6"), HasSubstr("line 7"),
                            HasSubstr("line 8"), HasSubstr("line 9")));
  EXPECT_THAT(faults, AllOf(Not(HasSubstr("line 3")), HasSubstr("tokens"), Not(HasSubstr("the-token-itself"))));
}

TEST(Tokens, ParseReportsAtMost50Errors) {
  std::string text;
  for (int line = 0; line < 10000; ++line) text += "x\n";
  const std::string faults(TokenTable::Parse(text, "tokens").status().message());
  EXPECT_THAT(faults, AllOf(HasSubstr("line 50: found 50 errors so far"), Not(HasSubstr("line 51"))));
}

}  // namespace
}  // namespace tessera
