// Photographs of blocks are found by the ends of their paths.
#include "common/blocks/photograph_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "common/storage/files.h"
#include "tests/support/blocks/write_image_header.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::HasSubstr;

class PhotographFilesTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(FreshTestFolder("photographs")).lexically_normal();
    block_ = folder_ + "/block";
    WriteText(folder_ + "/block.xml", "");
    WriteImageHeader(block_ + "/here.png", 30, 20);
    WriteImageHeader(block_ + "/sub/tail.png", 31, 20);
    WriteImageHeader(folder_ + "/may/a/x.png", 32, 20);
    WriteImageHeader(folder_ + "/may/b/x.png", 33, 20);
    WriteImageHeader(folder_ + "/june/b/x.png", 34, 20);
    WriteImageHeader(folder_ + "/june/b/here.png", 35, 20);
  }
  // The width tells the files apart; negative: the code of the error.
  int Width(const PhotographSearch& search, const std::string& path) const {
    const StatusOr<ImageSize> size = PhotographFiles(block_, search).SizeOf(path);
    return size.ok() ? size->width : -static_cast<int>(size.status().code());
  }

  static constexpr int kNotFound = -static_cast<int>(absl::StatusCode::kNotFound);
  static constexpr int kInvalid = -static_cast<int>(absl::StatusCode::kInvalidArgument);
  std::string folder_, block_;
};

TEST_F(PhotographFilesTest, SearchesTheFolderOfTheSource) {
  EXPECT_EQ(Width({}, "here.png"), 30);
  EXPECT_EQ(Width({}, block_ + "/here.png"), 30);
  EXPECT_EQ(Width({}, "file://" + block_ + "/here.png"), 30);
  EXPECT_EQ(Width({}, "sub\\tail.png"), 31);
  EXPECT_EQ(Width({}, "tail.png"), 31);
  EXPECT_EQ(Width({}, "D:\\Flight\\SUB\\Tail.PNG"), 31);
  EXPECT_EQ(Width({}, "D:\\tail"), 31) << "a label";
  EXPECT_EQ(Width({}, ""), kNotFound);
  EXPECT_EQ(Width({}, "C:\\a\\x.png"), kNotFound);
  EXPECT_EQ(PhotographFiles(folder_ + "/block.xml", {}).SizeOf("C:\\may\\a\\x.png")->width, 32) << "beside a file";
}

TEST_F(PhotographFilesTest, SearchesAllFoldersOfTheUser) {
  const PhotographSearch both = {.folders = {folder_ + "/may", folder_ + "/june"}};
  EXPECT_EQ(Width(both, "C:\\may\\a\\x.png"), 32);
  EXPECT_EQ(Width(both, "/elsewhere/june/b/x.png"), 34);
  EXPECT_EQ(Width(both, "D:\\other\\a\\x.png"), 32);
  EXPECT_EQ(Width(both, "D:\\other\\b\\x.png"), kInvalid);
  EXPECT_THAT(std::string(PhotographFiles(block_, both).Find("b\\x.png").status().message()),
              HasSubstr("image 'b\\x.png', which may be " + folder_ + "/june/b/x.png or " + folder_ + "/may/b/x.png"));
  EXPECT_EQ(Width(both, "here.png"), 30) << "the path leads to a file";
  EXPECT_EQ(Width(both, "D:\\here.png"), 35);
  EXPECT_EQ(Width(both, "D:\\flight\\sub\\tail.png"), kNotFound) << "the folders replace that of the source";
}

TEST_F(PhotographFilesTest, ReplacesBeginningsOfPaths) {
  const PhotographSearch search = {.replacements = {{"D:\\flights", folder_ + "/may"}, {"E:", folder_}}};
  EXPECT_EQ(Width(search, "d:\\flights\\b\\x.png"), 33);
  EXPECT_EQ(Width(search, "E:\\june\\b\\x.png"), 34);
  EXPECT_EQ(Width(search, "D:\\flightsof\\b\\x.png"), kNotFound);
}

}  // namespace
}  // namespace tessera
