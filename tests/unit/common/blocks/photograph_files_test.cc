// Photographs of blocks are found by the ends of their paths.
#include "common/blocks/photograph_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/blocks/write_image_header.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::HasSubstr;

TEST(PhotographFilesTest, FindsPhotographsByTheLongestCommonTail) {
  const std::string folder = FreshTestFolder("entries"), block = folder + "/block", images = folder + "/images";
  WriteImageHeader(block + "/here.png", 30, 20);
  WriteImageHeader(block + "/sub/tail.png", 31, 20);
  WriteImageHeader(images + "/day1/a/x.png", 32, 20);
  WriteImageHeader(images + "/day1/b/x.png", 33, 20);
  WriteImageHeader(images + "/day2/b/x.png", 34, 20);
  WriteImageHeader(images + "/day2/b/here.png", 35, 20);
  PhotographFiles without(block, ""), with(block, images);
  const auto width = [](PhotographFiles& files, const std::string& path) {
    const StatusOr<ImageSize> size = files.SizeOf(path);
    return size.ok() ? size->width : -static_cast<int>(size.status().code());
  };
  constexpr int kNotFound = -static_cast<int>(absl::StatusCode::kNotFound);
  constexpr int kInvalid = -static_cast<int>(absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(width(without, "here.png"), 30);
  EXPECT_EQ(width(without, block + "/here.png"), 30);
  EXPECT_EQ(width(without, "sub\\tail.png"), 31);
  EXPECT_EQ(width(without, "D:\\flight\\sub\\tail.png"), 31);
  EXPECT_EQ(width(without, "tail.png"), kNotFound);
  EXPECT_EQ(width(without, ""), kNotFound);
  EXPECT_EQ(width(without, "C:\\day1\\a\\x.png"), kNotFound);
  EXPECT_EQ(width(with, "C:\\day1\\a\\x.png"), 32);
  EXPECT_EQ(width(with, "/elsewhere/day2/b/x.png"), 34);
  EXPECT_EQ(width(with, "D:\\other\\a\\x.png"), 32);
  EXPECT_EQ(width(with, "D:\\other\\b\\x.png"), kInvalid);
  EXPECT_THAT(std::string(with.Find("b/x.png").status().message()), HasSubstr("day1/b/x.png, day2/b/x.png"));
  EXPECT_EQ(width(with, "D:\\flight\\sub\\tail.png"), 31);  // beside the block
}

}  // namespace
}  // namespace tessera
