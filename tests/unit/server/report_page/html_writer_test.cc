#include "server/report_page/html_writer.h"

#include <gmock/gmock.h>

#include "common/base/printable.h"
#include "tests/unit/server/report_page/page_fixtures.h"

namespace tessera {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(HtmlText, EscapesMarkup) {
  EXPECT_EQ(HtmlText("<img src=x onerror=\"a('b')\"> & more").markup(),
            "&lt;img src=x onerror=&quot;a(&#39;b&#39;)&quot;&gt; &amp; more");
  EXPECT_EQ(HtmlText("Stra\xc3\x9f"
                     "e")
                .markup(),
            "Stra\xc3\x9f"
            "e");
}

TEST(HtmlText, ShowsBytesThatAreNotText) {
  EXPECT_EQ(HtmlText("a\xff\xfe"
                     "b")
                .markup(),
            "a\\xff\\xfeb");
  EXPECT_EQ(HtmlText(std::string("a\0b\x1b\x7f", 5)).markup(), "a\\x00b\\x1b\\x7f");
  EXPECT_EQ(HtmlText("\xe2\x80\xae"
                     "gpj.exe")
                .markup(),
            "\\u202egpj.exe")
      << "turns the direction of text";
}

TEST(HtmlText, IsCutBetweenCharacters) {
  std::string text;
  for (int i = 0; i < 5000; ++i) text += "\xc3\x9f";
  const std::string markup = HtmlText(text).markup();
  EXPECT_LT(markup.size(), 1100u);
  EXPECT_TRUE(IsUtf8(markup));
  EXPECT_THAT(markup, Not(HasSubstr("\\x")));
}

TEST(HtmlElement, EscapesAttributes) {
  const std::string markup = HtmlElement("p", {{"title", "\"><script>"}}, HtmlText("x")).markup();
  EXPECT_EQ(markup, "<p title=\"&quot;&gt;&lt;script&gt;\">x</p>\n");
  EXPECT_EQ(HtmlElement("img", {{"alt", "a"}}).markup(), "<img alt=\"a\"/>\n");
}

TEST(HtmlDocument, PermitsNoScriptsAndNoNetwork) {
  const std::string page = HtmlDocument("<b>", "p { margin:0; }", HtmlElement("p", HtmlText("x")));
  const pugi::xml_document document = ParsePage(page);
  const pugi::xml_node head = document.child("html").child("head");
  EXPECT_STREQ(head.child_value("title"), "<b>");
  const pugi::xml_node policy = head.find_child_by_attribute("meta", "http-equiv", "Content-Security-Policy");
  EXPECT_STREQ(policy.attribute("content").value(), "default-src 'none'; img-src data:; style-src 'unsafe-inline'");
}

}  // namespace
}  // namespace tessera
