#include "server/http/gzip.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/unit/server/http/inflated.h"

namespace tessera {
namespace {

TEST(GzipTest, StreamsShareParts) {
  std::vector<GzipPart> parts;
  std::vector<std::string> texts = {"", "a", std::string(100'000, 'b'), "event: end\n\n"};
  for (const std::string& text : texts) parts.emplace_back(text);
  for (const auto& order : std::vector<std::vector<size_t>>{{0, 1, 2, 3}, {2, 3}, {1, 1, 2, 2}}) {
    GzipStream stream;
    std::string sent, expected;
    bool whole = false;
    for (const size_t i : order) {
      sent += stream.Add(parts[i]);
      expected += texts[i];
      EXPECT_EQ(Inflated(sent, &whole), expected) << "each part can be read when it has come";
      EXPECT_FALSE(whole);
    }
    EXPECT_EQ(Inflated(sent + stream.End(), &whole), expected);
    EXPECT_TRUE(whole);
  }
  EXPECT_LT(parts[2].bytes.size(), 1000U);
}

TEST(GzipTest, TextsAreCompressed) {
  const std::string text(100'000, 'b');
  bool whole = false;
  EXPECT_EQ(Inflated(Gzip(text), &whole), text);
  EXPECT_TRUE(whole);
  EXPECT_LT(Gzip(text).size(), 1000U);
}

}  // namespace
}  // namespace tessera
