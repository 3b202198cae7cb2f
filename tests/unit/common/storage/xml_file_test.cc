// Bounds and messages of XML files and zip archives.
#include "common/storage/xml_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>

#include "absl/strings/str_cat.h"
#include "common/storage/zip_file.h"
#include "tests/support/blocks/make_zip.h"

namespace tessera {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string XmlRefusal(const std::string& text) {
  return std::string(XmlFile::Parse(text, "f.xml").status().message());
}

std::string NestedXml(int depth) {
  std::string text;
  for (int i = 0; i < depth; ++i) text += "<a>";
  for (int i = 0; i < depth; ++i) text += "</a>";
  return text;
}

TEST(XmlFile, ReadsTextAttributesAndNumbers) {
  const auto file = XmlFile::Parse(
      "<?xml version='1.0'?><!-- <x> --><!DOCTYPE r>\n<r a=' 1.5 ' n='7'><b> &lt;x&gt; </b>"
      "<c>1e-3\n+2 -3</c><c>4</c><d><![CDATA[ 9 ]]></d></r>",
      "f.xml");
  ASSERT_TRUE(file.ok()) << file.status();
  Faults faults;
  const XmlNode root = file->Root();
  EXPECT_EQ(root.Name(), "r");
  EXPECT_EQ(root.NumberAttribute("a", &faults), 1.5);
  EXPECT_EQ(root.IntegerAttribute("n", &faults), 7);
  EXPECT_EQ(root.Child("b").Text(), "<x>");
  EXPECT_EQ(root.ChildInteger("d", &faults), 9);
  EXPECT_EQ(root.ChildNumberOr("missing", 3, &faults), 3);
  std::array<double, 3> numbers;
  EXPECT_TRUE(root.Child("c").Numbers(numbers, &faults));
  EXPECT_THAT(numbers, ElementsAre(1e-3, 2, -3));
  EXPECT_EQ(root.Child("c").Next("c").Number(&faults), 4);
  EXPECT_FALSE(root.Child("c").Next("c").Next("c"));
  EXPECT_FALSE(root.Child("x").Child("y"));
  EXPECT_TRUE(faults.empty());
}

TEST(XmlFile, FaultsNameFileElementAndLine) {
  const auto file = XmlFile::Parse("<r>\n<a>\n<b>1,5</b><c>nan</c><d>1e999</d></a></r>", "f.xml");
  ASSERT_TRUE(file.ok());
  Faults faults;
  const XmlNode a = file->Root().Child("a");
  for (const char* name : {"b", "c", "d", "e"}) EXPECT_FALSE(a.ChildNumber(name, &faults).has_value());
  EXPECT_THAT(faults.messages(), ElementsAre("f.xml: /r/a/b (line 3, byte 9): found '1,5', expected a number",
                                             HasSubstr("/r/a/c (line 3, byte 19): found 'nan'"), HasSubstr("'1e999'"),
                                             "f.xml: /r/a (line 2, byte 5): found no element e, expected one"));
}

TEST(XmlFile, AddsABoundedNumberOfFaults) {
  const auto file = XmlFile::Parse("<r>x</r>", "f.xml");
  Faults faults;
  for (int i = 0; i < 3000; ++i) file->Root().Number(&faults);
  EXPECT_EQ(faults.messages().size(), 1001u);
}

TEST(XmlFile, HasSeveralRoots) {
  const auto file = XmlFile::Parse("<?xml version=\"1.0\"?>\n<t>1</t>\n<t>2</t>", "f.xml");
  ASSERT_TRUE(file.ok()) << file.status();
  EXPECT_EQ(file->Root().Next("t").Text(), "2");
}

TEST(XmlFile, RefusesWhatIsOutOfBounds) {
  EXPECT_THAT(XmlRefusal("<!DOCTYPE r [<!ENTITY a 'b'>]><r>&a;</r>"), HasSubstr("line 1: found a document type"));
  EXPECT_THAT(XmlRefusal(NestedXml(65)), HasSubstr("deeper than 64"));
  EXPECT_EQ(XmlRefusal(NestedXml(64)), "");
  EXPECT_THAT(XmlRefusal(std::string("<\0a\0>\0", 6)), HasSubstr("byte 1: found a zero byte"));
  EXPECT_THAT(XmlRefusal("<r>\xe9</r>"), HasSubstr("not UTF-8"));
  EXPECT_THAT(XmlRefusal("<r>\n<a>1</a>\n<b"), HasSubstr("line 3: found text that is not well-formed"));
  EXPECT_THAT(XmlRefusal("<r><a></r>"), HasSubstr("not well-formed"));
  EXPECT_THAT(XmlRefusal(""), HasSubstr("not well-formed"));
}

TEST(XmlRootName, SkipsWhatIsBeforeTheElement) {
  EXPECT_EQ(XmlRootName("\xef\xbb\xbf<?xml?>\n<!-- <a> --><!DOCTYPE b>\n<root x='1'>"), "root");
  EXPECT_EQ(XmlRootName("<root/>"), "root");
  EXPECT_EQ(XmlRootName("ply\n"), "");
  EXPECT_EQ(XmlRootName("<!-- cut"), "");
}

std::string ZipRefusal(const std::string& bytes, const std::string& member = "a.txt", int64_t max_bytes = 100) {
  StatusOr<ZipFile> zip = ZipFile::Parse(bytes, "f.zip");
  return std::string(zip.ok() ? zip->Read(member, max_bytes).status().message() : zip.status().message());
}

TEST(ZipFile, ReadsMembers) {
  StatusOr<ZipFile> zip = ZipFile::Parse(MakeZip({{"a.txt", "alpha"}, {"d/", ""}, {"d/b", ""}}), "f.zip");
  ASSERT_TRUE(zip.ok()) << zip.status();
  EXPECT_THAT(zip->members(), ElementsAre("a.txt", "d/b"));
  EXPECT_EQ(zip->Read("a.txt", 5).value(), "alpha");
  EXPECT_EQ(zip->Read("d/b", 5).value(), "");
  EXPECT_EQ(zip->ReadHead("a.txt", 2), "al");
  EXPECT_EQ(zip->ReadHead("x", 2), "");
}

TEST(ZipFile, RefusesWhatIsOutOfBoundsOrDamaged) {
  const std::string good = MakeZip({{"a.txt", "alpha"}});
  EXPECT_EQ(ZipRefusal(good), "");
  EXPECT_THAT(ZipRefusal(good, "a.txt", 4), HasSubstr("f.zip/a.txt: found 5 bytes, expected at most 4"));
  EXPECT_THAT(ZipRefusal(good, "b.txt"), HasSubstr("no such member"));
  for (const char* name : {"../a", "/a", "a/../../b", "a\\b", "C:a"}) {
    EXPECT_THAT(ZipRefusal(MakeZip({{name, "x"}})), HasSubstr("a name inside the archive")) << name;
  }
  EXPECT_THAT(ZipRefusal(MakeZip({{"a.txt", "x"}, {"a.txt", "y"}})), HasSubstr("each name once"));
  EXPECT_THAT(ZipRefusal(good.substr(0, good.size() - 30)), HasSubstr("f.zip: found"));
  std::string damaged = good;
  damaged[damaged.find("alpha")] = 'b';
  EXPECT_THAT(ZipRefusal(damaged), HasSubstr("a member that is whole"));
  std::string impossible = good;  // 16 MiB from 5 bytes
  impossible[impossible.rfind("PK\1\2") + 27] = 1;
  EXPECT_THAT(ZipRefusal(impossible, "a.txt", 1 << 30), HasSubstr("f.zip"));
}

}  // namespace
}  // namespace tessera
