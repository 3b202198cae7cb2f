#include "common/base/message_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_cat.h"

#include <algorithm>

#include "common/base/status.h"

namespace tessera {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

Status FaultOfImage(int i) {
  const std::string name = absl::StrCat("a", i, ".jpg");
  return InputError(absl::StrCat("images/", name), "", "no such file", absl::StrCat("image '", name, "' of the model"));
}

TEST(MessageListTest, ShortListsStay) {
  EXPECT_THAT(ShortenMessages({"b", "a", "b"}), ElementsAre("b", "a", "b"));
  EXPECT_EQ(ShortenLines("one\n  more of one\ntwo"), "one\n  more of one\ntwo");
}

TEST(MessageListTest, LongListsAreCutWithTheNumberOfTheRest) {
  std::vector<std::string> messages;
  for (int i = 0; i < 900; ++i) messages.emplace_back(FaultOfImage(i).message());
  const std::vector<std::string> shown = ShortenMessages(messages);
  ASSERT_THAT(shown, SizeIs(kShownMessages + 1));
  EXPECT_EQ(shown.front(), messages.front());
  EXPECT_EQ(shown[kShownMessages - 1], messages[kShownMessages - 1]);
  EXPECT_EQ(shown.back(), "... and 880 more");
  std::vector<std::string> again = shown;
  again.emplace_back("of another kind");
  EXPECT_THAT(ShortenMessages(again), Contains("... and 881 more")) << "counts what was left out before";
}

TEST(MessageListTest, AFrequentKindHidesNoOther) {
  Faults faults;
  for (int i = 0; i < 900; ++i) faults.Add(FaultOfImage(i));
  faults.Add(InputError("mesh.ply", "header", "no faces", "a mesh"));
  const std::string text(faults.ToStatus().message());
  EXPECT_THAT(text, HasSubstr("mesh.ply: header: found no faces, expected a mesh"));
  EXPECT_THAT(text, HasSubstr("... and 881 more"));
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 20);
}

TEST(MessageListTest, ContinuedLinesBelongToTheirMessage) {
  std::string text = "a: first\n  second line of it";
  for (int i = 0; i < 30; ++i) text += "\nb: other";
  const std::string shown = ShortenLines(text);
  EXPECT_TRUE(shown.starts_with("a: first\n  second line of it\nb: other"));
  EXPECT_TRUE(shown.ends_with("\n... and 11 more"));
}

}  // namespace
}  // namespace tessera
