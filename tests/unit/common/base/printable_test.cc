#include "common/base/printable.h"

#include <gtest/gtest.h>

namespace tessera {
namespace {

TEST(Printable, EscapesControlAndInvisibleCharacters) {
  EXPECT_EQ(Printable("Zürich, Straße 7 \\ \"a\" 橋 👨‍👩‍👧"),
            "Zürich, Straße 7 \\ \"a\" 橋 👨‍👩‍👧");
  EXPECT_EQ(Printable("a\nb\tc\rd"), "a\\nb\\tc\\x0dd");
  EXPECT_EQ(Printable("\x1b[2J\x07"), "\\x1b[2J\\x07");
  EXPECT_EQ(Printable(std::string("a\0b\x7f", 4)), "a\\x00b\\x7f");
  EXPECT_EQ(Printable("\xC2\x9B"
                      "31m"),
            "\\u009b31m")
      << "C1: a control sequence as well";
  EXPECT_EQ(Printable("\u202egnp.exe\u2028x\ufeff\U000E0041"), "\\u202egnp.exe\\u2028x\\ufeff\\ue0041");
  EXPECT_EQ(PrintableLines("a\nb\x1b[1mc\r\n\td"), "a\nb\\x1b[1mc\\x0d\n\td");
}

TEST(Printable, EscapesBytesThatAreNotUtf8) {
  EXPECT_EQ(Printable("\x9B"
                      "31m"),
            "\\x9b31m");
  EXPECT_EQ(Printable("a\xC3"), "a\\xc3") << "cut off";
  EXPECT_EQ(Printable("\xC0\x8A"), "\\xc0\\x8a") << "an overlong line end";
  EXPECT_EQ(Printable("\xE0\x80\x8A"), "\\xe0\\x80\\x8a");
  EXPECT_EQ(Printable("\xED\xA0\x80"), "\\xed\\xa0\\x80") << "a surrogate";
  EXPECT_EQ(Printable("\xF4\x90\x80\x80\xFF"), "\\xf4\\x90\\x80\\x80\\xff");
}

TEST(Printable, QuotesForJson) {
  EXPECT_EQ(JsonQuoted("a\"b\\c\nd\x1b\xC2\x9B\u202eü"), R"("a\"b\\c\nd\u001b\u009b\u202eü")");
  EXPECT_EQ(JsonQuoted("\xFF\U000E0041"), "\"\\ufffd\\udb40\\udc41\"");
}

TEST(Printable, CutsAtCharacterBoundaries) {
  EXPECT_EQ(Prefix("abc", 3), "abc");
  EXPECT_EQ(Prefix("abc", 2), "ab");
  EXPECT_EQ(Prefix("aü", 2), "a");
  EXPECT_EQ(Prefix("a👨b", 4), "a");
  EXPECT_EQ(Prefix(std::string(9, '\x80'), 6).size(), 2u) << "no characters at all: it does not look far for one";
}

TEST(Printable, RecognisesUtf8) {
  for (const char* text : {"", "plain\n", "Zürich", "\xf0\x9f\x8f\x99"}) {
    EXPECT_TRUE(IsUtf8(text)) << text;
    EXPECT_EQ(AsUtf8(text), text);
  }
  for (const char* text : {"\xff", "a\xc3", "\xc0\x80", "\xed\xa0\x80"}) {
    EXPECT_FALSE(IsUtf8(text)) << text;
    EXPECT_TRUE(IsUtf8(AsUtf8(text))) << text;
  }
  EXPECT_EQ(AsUtf8("image\xff\n"), "image\\xff\n");
}

}  // namespace
}  // namespace tessera
