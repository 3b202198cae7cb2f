#include "common/scene/image_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

ImageFiles Find(const std::vector<std::string>& names, const std::set<std::string>& folder) {
  return FindImageFiles(
      names, [&](const std::string& name) { return folder.contains(name); },
      [&] { return std::vector<std::string>(folder.begin(), folder.end()); });
}

TEST(ImageFilesTest, PlainNames) {
  EXPECT_EQ(PlainImageName("a.jpg"), "a.jpg");
  EXPECT_EQ(PlainImageName(".\\a\\.\\b c.jpg"), "a/b c.jpg");
  EXPECT_EQ(PlainImageName("a//b.jpg"), "a/b.jpg");
  EXPECT_EQ(PlainImageName("../a.jpg"), "../a.jpg");
  EXPECT_EQ(PlainImageName("/a.jpg"), "/a.jpg");
  EXPECT_EQ(PlainImageName("..."), "...");
  EXPECT_EQ(PlainImageName(""), "");
}

TEST(ImageFilesTest, TheMostExactNameIsFound) {
  const ImageFiles found = Find({"a.jpg", "A.jpg", "x\\b.jpg", "./c.jpg", "D.JPG"},
                                {"a.jpg", "A.jpg", "x\\b.jpg", "x/b.jpg", "c.jpg", "d.jpg"});
  EXPECT_THAT(found.files, ElementsAre("a.jpg", "A.jpg", "x\\b.jpg", "c.jpg", "d.jpg"));
  EXPECT_EQ(found.other_case, 1);
  EXPECT_EQ(found.other_case_name, "D.JPG");
}

TEST(ImageFilesTest, AFolderIsListedOnlyForNamesWithoutFiles) {
  FindImageFiles(
      {"./a.jpg"}, [](const std::string& name) { return name == "a.jpg"; },
      []() -> std::vector<std::string> {
        ADD_FAILURE() << "listed";
        return {};
      });
}

TEST(ImageFilesTest, AmbiguousAndMissingNamesHaveHints) {
  const ImageFiles found = Find({"a.jpg", "b.jpg", "c.jpg", "d\xe9.jpg"}, {"A.jpg", "a.JPG", "north/B.jpg"});
  EXPECT_THAT(found.files, ElementsAre("", "", "", ""));
  EXPECT_THAT(found.hints, ElementsAre(HasSubstr("'A.jpg' and 'a.JPG' differ from 'a.jpg'"),
                                       HasSubstr("has 'north/B.jpg' for 'b.jpg'"), "", HasSubstr("UTF-8")));
}

}  // namespace
}  // namespace tessera
