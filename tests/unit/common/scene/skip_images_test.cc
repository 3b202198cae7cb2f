// Scenes with missing and broken images: refused, or used without these images.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <limits>

#include "common/check/check.h"
#include "common/scene/skip_images.h"
#include "common/storage/files.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

namespace fs = std::filesystem;

constexpr double kOneOfFive = 0.2;

class SkipImagesTest : public testing::Test {
 protected:
  SkipImagesTest() : views_(WriteTinyScene(folder_).cameras.size()) {}

  std::string Image(const std::string& name) const { return folder_ + "/images/" + name; }
  // Keeps the header and the first rows.
  void Truncate(const std::string& name) const { fs::resize_file(Image(name), fs::file_size(Image(name)) / 2); }
  StatusOr<CheckedScene> Check(double share) {
    SceneLoadOptions load;
    load.skip_images = share;
    warnings_.clear();
    return CheckScene(folder_, load, std::numeric_limits<int64_t>::max(), &warnings_, {});
  }
  std::string Refusal(double share) {
    const StatusOr<CheckedScene> checked = Check(share);
    EXPECT_EQ(checked.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(checked.status().message());
  }

  const std::string folder_ = FreshTestFolder("scene");
  const size_t views_;
  Warnings warnings_;
};

TEST_F(SkipImagesTest, AMissingImageIsLeftOutAndListed) {
  fs::remove(Image("view1.png"));
  EXPECT_THAT(Refusal(0), AllOf(HasSubstr("view1.png: found no such file"),
                                HasSubstr("\nto leave out the 1 missing or broken images: --skip-images 0.")));
  const StatusOr<CheckedScene> checked = Check(kOneOfFive);
  ASSERT_TRUE(checked.ok()) << checked.status();
  EXPECT_EQ(checked->scene.views.size(), views_ - 1);
  EXPECT_EQ(checked->summary.images, static_cast<int64_t>(views_) - 1);
  EXPECT_EQ(checked->summary.contents.size(), views_ - 1);
  for (const SceneView& view : checked->scene.views) EXPECT_NE(view.name, "view1.png");
  EXPECT_EQ(checked->scene.views[1].likelihood_path, "likelihoods/view2.tif") << "lists of views stay aligned";
  ASSERT_EQ(checked->summary.skipped.size(), 1u);
  EXPECT_EQ(checked->summary.skipped[0].name, "view1.png");
  EXPECT_EQ(checked->summary.skipped[0].reason, "no such file");
  EXPECT_THAT(warnings_, testing::Contains(HasSubstr("images are left out: view1.png (no such file)")));
  EXPECT_THAT(SummaryToJson(checked->summary, {}), HasSubstr("\"name\": \"view1.png\""));
  EXPECT_THAT(SummaryToText(checked->summary), HasSubstr("left out       1 images"));
}

TEST_F(SkipImagesTest, ABrokenImageIsLeftOutWhereverItIsFound) {
  Truncate("view2.png");  // found when it is decoded
  EXPECT_THAT(Refusal(0), AllOf(HasSubstr("view2.png"), HasSubstr("--skip-images")));
  StatusOr<CheckedScene> checked = Check(kOneOfFive);
  ASSERT_TRUE(checked.ok()) << checked.status();
  ASSERT_EQ(checked->summary.skipped.size(), 1u);
  EXPECT_EQ(checked->summary.skipped[0].name, "view2.png");
  for (const PixelContent& content : checked->summary.contents) EXPECT_NE(content.image, "");
  WriteText(Image("view2.png"), "");  // found when its header is read
  checked = Check(kOneOfFive);
  ASSERT_TRUE(checked.ok()) << checked.status();
  EXPECT_EQ(checked->summary.skipped[0].reason, "byte 0: an empty file");
  // Every process gets the file, so that all leave it out for the same reason.
  EXPECT_THAT(checked->scene.files, testing::Contains("images/view2.png"));
}

TEST_F(SkipImagesTest, TheShareIsALimitOfBothKindsTogether) {
  fs::remove(Image("view1.png"));
  Truncate("view2.png");
  EXPECT_THAT(Refusal(1.5 / static_cast<double>(views_)),
              AllOf(HasSubstr("images: found 2 of"), HasSubstr("(--skip-images)"), HasSubstr("view2.png")));
  const StatusOr<CheckedScene> checked = Check(0.5);
  ASSERT_TRUE(checked.ok()) << checked.status();
  EXPECT_EQ(checked->summary.skipped.size(), 2u);
}

TEST_F(SkipImagesTest, OtherFaultsAreNotSkipped) {
  fs::remove(folder_ + "/likelihoods/view1.tif");
  EXPECT_THAT(Refusal(0.9), AllOf(HasSubstr("likelihoods of image 'view1.png'"), Not(HasSubstr("--skip-images"))));
}

TEST_F(SkipImagesTest, NoSceneIsLeftWithoutImages) {
  fs::remove_all(folder_ + "/images");
  fs::create_directory(folder_ + "/images");
  EXPECT_THAT(Refusal(1), HasSubstr("no files of "));
}

TEST(SkipAdviceTest, ProposesAShareThatSuffices) {
  SceneDescription scene;
  scene.views.resize(30);
  EXPECT_TRUE(SkipAdvice(scene).ok());
  scene.unusable_images = 1;
  EXPECT_THAT(std::string(SkipAdvice(scene).message()), HasSubstr("--skip-images 0.1"));
  scene.unusable_images = 7;
  EXPECT_THAT(std::string(SkipAdvice(scene).message()), HasSubstr("--skip-images 0.24"));
  scene.unusable_images = 20;
  EXPECT_TRUE(SkipAdvice(scene).ok()) << "too many to go on";
}

}  // namespace
}  // namespace tessera
