#include "common/base/json_bounds.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tessera {
namespace {

TEST(JsonBounds, LimitsNestingDepth) {
  const auto nested = [](int depth) {
    return std::string(static_cast<size_t>(depth), '[') + std::string(static_cast<size_t>(depth), ']');
  };
  EXPECT_TRUE(CheckJsonDepth("it", "").ok());
  EXPECT_TRUE(CheckJsonDepth("it", nested(kMaxJsonDepth)).ok());
  const Status deep = CheckJsonDepth("it", "{\"a\":" + nested(kMaxJsonDepth) + "}");
  EXPECT_EQ(deep.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(deep.message()),
              testing::HasSubstr("it: found JSON nested 65 levels deep, expected at most 64 levels"));
  std::string wide = "[";
  for (int i = 0; i < 1000; ++i) wide += "[],";
  EXPECT_TRUE(CheckJsonDepth("it", wide + "0]").ok());
}

TEST(JsonBounds, IgnoresBracketsInStrings) {
  const std::string brackets(1000, '[');
  EXPECT_TRUE(CheckJsonDepth("it", "[\"" + brackets + "\"]").ok());
  EXPECT_TRUE(CheckJsonDepth("it", R"(["a\"b)" + brackets + "\"]").ok()) << "the quote is the string's own";
  EXPECT_FALSE(CheckJsonDepth("it", R"(["a\\")" + brackets).ok()) << "the backslash is, the quote ends it";
}

}  // namespace
}  // namespace tessera
