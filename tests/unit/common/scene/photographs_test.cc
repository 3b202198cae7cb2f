#include "common/scene/photographs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "common/check/check.h"
#include "common/scene/scene.h"
#include "tests/support/tiny_scene.h"
#include "tests/support/wide_tiff.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;

namespace fs = std::filesystem;

constexpr int kImageWidth = 160, kImageHeight = 120;

ByteImage Mask(int width, int height, int masked_columns) {
  ByteImage mask(width, height, 1, 255);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < masked_columns; ++x) mask.at(x, y) = 0;
  }
  return mask;
}

struct Checked {
  StatusOr<SceneSummary> summary = SceneSummary();
  std::vector<int> white_levels;  // of each view
  Warnings warnings;
  std::string fault() const { return std::string(summary.status().message()); }
};
Checked CheckFolder(const std::string& folder) {
  Checked checked;
  const StatusOr<CheckedScene> found =
      CheckScene(folder, {}, std::numeric_limits<int64_t>::max(), &checked.warnings, {});
  if (!found.ok()) {
    checked.summary = found.status();
    return checked;
  }
  checked.summary = found->summary;
  for (const SceneView& view : found->scene.views) checked.white_levels.push_back(view.white_level);
  return checked;
}

TEST(ScenePhotographsTest, FindsMasksByTheirNames) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  const Checked before = CheckFolder(folder);
  ASSERT_TRUE(before.summary.ok()) << before.summary.status();
  fs::create_directory(folder + "/masks");
  ASSERT_TRUE(WritePng(folder + "/masks/view0.png.png", Mask(kImageWidth, kImageHeight, 40)).ok());
  ASSERT_TRUE(WritePng(folder + "/masks/view1.mask.png", Mask(kImageWidth / 2, kImageHeight / 2, 20)).ok());
  ASSERT_TRUE(WritePng(folder + "/masks/view2.png", Mask(kImageWidth, kImageHeight, 0)).ok());
  ASSERT_TRUE(WritePng(folder + "/masks/veiw3.png", Mask(kImageWidth, kImageHeight, 9)).ok());
  const StatusOr<SceneDescription> scene = LoadScene(folder, nullptr);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->views[0].mask_path, "masks/view0.png.png");
  EXPECT_EQ(scene->views[1].mask_path, "masks/view1.mask.png");
  EXPECT_EQ(scene->views[2].mask_path, "masks/view2.png");
  EXPECT_EQ(scene->views[3].mask_path, "");
  EXPECT_TRUE(scene->views[0].masked);
  EXPECT_FALSE(scene->views[3].masked);
  EXPECT_THAT(scene->files, Contains("masks/view1.mask.png"));
  EXPECT_THAT(scene->files, Not(Contains("masks/veiw3.png")));

  const Checked checked = CheckFolder(folder);
  ASSERT_TRUE(checked.summary.ok()) << checked.summary.status();
  EXPECT_NEAR(checked.summary->contents[0].masked_share, 0.25, 1e-9);
  EXPECT_NEAR(checked.summary->contents[1].masked_share, 0.25, 1e-9);
  EXPECT_EQ(checked.summary->contents[2].masked_share, 0);
  EXPECT_NE(checked.summary->contents[0].image, before.summary->contents[0].image);
  EXPECT_EQ(checked.summary->contents[2].image, before.summary->contents[2].image);
  EXPECT_THAT(checked.warnings,
              Contains(AllOf(HasSubstr("masks: 1 files belong to no image"), HasSubstr("veiw3.png"))));
  EXPECT_THAT(checked.warnings, Contains(HasSubstr("masks: 3 of 5 images have a mask")));
  EXPECT_THAT(checked.warnings, Contains(HasSubstr("2 images have a mask or transparent pixels: 25.0 % of their")));
}

TEST(ScenePhotographsTest, RefusesMasksThatDoNotFit) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  ReplaceInFile(folder + "/scene.json", "{", R"({"masks": "black", )");
  EXPECT_THAT(CheckFolder(folder).fault(), HasSubstr("black: found no such folder, expected the masks"));
  fs::create_directory(folder + "/black");
  ASSERT_TRUE(WritePng(folder + "/black/view0.png", Mask(kImageWidth, kImageHeight, 1)).ok());
  ASSERT_TRUE(WritePng(folder + "/black/view0.mask.png", Mask(kImageWidth, kImageHeight, 1)).ok());
  EXPECT_THAT(CheckFolder(folder).fault(), HasSubstr("found a second mask of image 'view0.png'"));
  fs::remove(folder + "/black/view0.mask.png");
  ASSERT_TRUE(WritePng(folder + "/black/view0.png", Mask(kImageWidth, kImageWidth, 1)).ok());
  EXPECT_THAT(CheckFolder(folder).fault(), HasSubstr("black/view0.png: found a mask of 160 x 160 pixels"));
}

TEST(ScenePhotographsTest, ScalesIntrinsicsIfAllImagesAreScaled) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  const StatusOr<SceneDescription> full = LoadScene(folder, nullptr);
  ASSERT_TRUE(full.ok()) << full.status();
  std::vector<ByteImage> halves;
  for (const SceneView& view : full->views) {
    const StatusOr<ByteImage> image = ReadRgb(folder + "/" + view.image_path);
    ASSERT_TRUE(image.ok());
    ByteImage& half = halves.emplace_back(kImageWidth / 2, kImageHeight / 2);
    for (int y = 0; y < half.height; ++y) {
      for (int x = 0; x < half.width; ++x) half.at(x, y) = image->at(2 * x, 2 * y);
    }
  }
  ASSERT_TRUE(WritePng(folder + "/" + full->views[0].image_path, halves[0]).ok());
  EXPECT_THAT(CheckFolder(folder).fault(),
              HasSubstr("view0.png: found 80 x 60 pixels, expected 160 x 120 (the size of its camera): it has 0.5 "
                        "times this size; scale all images by this factor, or none"));
  for (size_t v = 0; v < halves.size(); ++v) {
    ASSERT_TRUE(WritePng(folder + "/" + full->views[v].image_path, halves[v]).ok());
  }
  Warnings warnings;
  const StatusOr<SceneDescription> scene = LoadScene(folder, &warnings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(warnings, Contains(AllOf(HasSubstr("all images have 0.5 times the size of their cameras"),
                                       HasSubstr("80 x 60 instead of 160 x 120"))));
  const PinholeCamera& before = full->views[2].lens.pinhole;
  EXPECT_EQ(scene->views[2].lens.pinhole,
            (PinholeCamera{80, 60, before.fx / 2, before.fy / 2, before.cx / 2, before.cy / 2}));
  EXPECT_EQ(scene->views[2].camera.intrinsics, scene->views[2].lens.pinhole);
}

TEST(ScenePhotographsTest, SaysThatAnImageIsTurned) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  ASSERT_TRUE(WritePng(folder + "/images/view1.png", ByteImage(kImageHeight, kImageWidth)).ok());
  EXPECT_THAT(CheckFolder(folder).fault(), HasSubstr("found 120 x 160 pixels, expected 160 x 120 (the size of its "
                                                     "camera): it was turned; use the image as the camera stored it"));
}

TEST(ScenePhotographsTest, TheRangeOfSixteenBitsIsThatOfTheFlight) {
  const std::string folder = FreshTestFolder("scene");
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kNone;
  WriteTinyScene(folder, options);
  const Checked eight = CheckFolder(folder);
  ASSERT_TRUE(eight.summary.ok()) << eight.summary.status();
  const StatusOr<SceneDescription> scene = LoadScene(folder, nullptr);
  std::vector<ByteImage> pictures;
  for (const SceneView& view : scene->views) {
    pictures.push_back(*ReadRgb(folder + "/" + view.image_path));
    WriteTiff16(folder + "/" + view.image_path, pictures.back(), 16);
  }
  const Checked twelve = CheckFolder(folder);
  ASSERT_TRUE(twelve.summary.ok()) << twelve.summary.status();
  EXPECT_THAT(twelve.white_levels, testing::Each(4095));
  EXPECT_THAT(twelve.warnings, Contains(AllOf(HasSubstr("images of 5 views"), HasSubstr("4095 is taken as white"))));
  SceneView view = LoadScene(folder, nullptr)->views[0];
  view.white_level = 4095;
  const StatusOr<FloatImage> image = ReadLuminance(folder + "/" + view.image_path, view.lens, OptionsOf(folder, view));
  ASSERT_TRUE(image.ok());
  EXPECT_NEAR(image->at(80, 60), pictures[0].at(80, 60) / 255.0, 0.005);
  // One image of the full range: all are.
  WriteTiff16(folder + "/" + scene->views[4].image_path, pictures[4], 257);
  const Checked wide = CheckFolder(folder);
  ASSERT_TRUE(wide.summary.ok()) << wide.summary.status();
  EXPECT_THAT(wide.white_levels, testing::Each(0));
  EXPECT_THAT(wide.warnings, Not(Contains(HasSubstr("taken as white"))));
}

TEST(ScenePhotographsTest, TellsOfOrientationTagsAndOfCopies) {
  const std::string folder = FreshTestFolder("scene");
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kNone;
  WriteTinyScene(folder, options);
  EXPECT_TRUE(CheckFolder(folder).warnings.empty());
  const std::string jpeg_path = folder + "/images/view3.png";  // the content decides
  ASSERT_TRUE(WriteJpeg(jpeg_path, *ReadRgb(jpeg_path), 95).ok());
  const std::string jpeg = ReadText(jpeg_path);
  const std::string exif("Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0", 32);
  WriteText(jpeg_path, jpeg.substr(0, 2) + std::string("\xff\xe1\0\x22", 4) + exif + jpeg.substr(2));
  EXPECT_THAT(CheckFolder(folder).warnings,
              Contains(AllOf(HasSubstr("images: 1 image has a tag of orientation, such as 'view3.png'"),
                             HasSubstr("as stored"))));
  fs::copy_file(folder + "/images/view1.png", folder + "/images/view2.png", fs::copy_options::overwrite_existing);
  EXPECT_THAT(CheckFolder(folder).warnings,
              Contains(AllOf(HasSubstr("1 image has the same pixels as another one, such as 'view1.png' "
                                       "and 'view2.png'"),
                             HasSubstr("different poses, of which one must be wrong"))));
}

}  // namespace
}  // namespace tessera
