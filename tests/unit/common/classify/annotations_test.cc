#include "common/classify/annotations.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/imaging/image_io.h"
#include "common/storage/files.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::HasSubstr;

class AnnotationsTest : public testing::Test {
 protected:
  AnnotationsTest() : folder_(FreshTestFolder("annotations")) {
    WriteTinyScene(folder_ + "/scene");
    scene_ = LoadScene(folder_ + "/scene", nullptr).value();
    EXPECT_TRUE(EnsureFolder(folder_ + "/painted").ok());
  }
  std::string Stem(size_t view) const { return scene_.views[view].name.substr(0, scene_.views[view].name.rfind('.')); }
  // All pixels have one value, except one row of each other class.
  ByteImage Numbers(int channels = 1, uint8_t value = 255) const {
    return ByteImage(scene_.views[0].lens.pinhole.width, scene_.views[0].lens.pinhole.height, channels, value);
  }
  static void Row(ByteImage* image, int y, std::vector<int> values) {
    for (int c = 0; c < image->channels; ++c) {
      for (int x = 0; x < image->width; ++x) image->at(x, y, c) = static_cast<uint8_t>(values[c]);
    }
  }
  void Colour(ByteImage* image, int y, size_t c, int off = 0) const {
    const auto& rgb = scene_.classes[c].color_rgb;
    Row(image, y, {rgb[0] + off, rgb[1] + off, rgb[2] + off});
  }
  void Paint(const std::string& name, const ByteImage& image) const {
    ASSERT_TRUE(WritePng(folder_ + "/painted/" + name, image).ok());
  }
  StatusOr<Annotations> Read() { return ReadAnnotations(folder_ + "/painted", scene_, &warnings_); }
  std::string Message() { return std::string(Read().status().message()); }

  const std::string folder_;
  SceneDescription scene_;
  Warnings warnings_;
};

TEST_F(AnnotationsTest, HaveTheWholeNameIfTwoImagesHaveOneStem) {
  scene_.views[1].name = "view2.jpg";  // beside view2.png
  ByteImage numbers = Numbers();
  for (int c = 0; c < 3; ++c) Row(&numbers, 10 * c, {c});
  Paint("view2.jpg.png", numbers);
  const StatusOr<Annotations> read = Read();
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->images.size(), 1u);
  EXPECT_EQ(read->images[0].view, 1u);
  Paint("view2.png", numbers);
  EXPECT_THAT(Message(), HasSubstr("painted/view2.png: found a name that matches no image"));
}

TEST_F(AnnotationsTest, ClassIdsAndColoursGiveEqualLabels) {
  ByteImage numbers = Numbers(), colours = Numbers(3);
  for (int c = 0; c < 3; ++c) {
    Row(&numbers, 10 * c, {c});
    Colour(&colours, 10 * c, c, c - 1);  // a shade beside the class's
  }
  Row(&colours, 50, {0, 0, 0});
  Paint(Stem(0) + ".png", numbers);
  Paint(Stem(1) + "_label.png", colours);
  const StatusOr<Annotations> read = Read();
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->images.size(), 2u);
  EXPECT_EQ(read->images[0].view, 0u);
  EXPECT_EQ(read->images[0].labels.data, numbers.data);
  EXPECT_EQ(read->images[1].labels.data, numbers.data);
  EXPECT_EQ(read->pixels, std::vector<int64_t>(3, 2 * numbers.width));
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(AnnotationsTest, RejectsUnknownClassIds) {
  ByteImage image = Numbers();
  Row(&image, 7, {9});
  Paint(Stem(0) + ".png", image);
  EXPECT_THAT(Message(), HasSubstr(Stem(0) + ".png: pixel (0, 7): found class 9, expected 0 ground"));
}

TEST_F(AnnotationsTest, RejectsPhotographsBelowThePaint) {
  ByteImage image = Numbers(3, 90);
  Colour(&image, 3, 1);
  Paint(Stem(0) + ".png", image);
  EXPECT_THAT(Message(), HasSubstr("painted pixels in unknown colours, mostly #5a5a5a, expected ground #808080"));
}

TEST_F(AnnotationsTest, IgnoresAFewBlendedPixels) {
  ByteImage image = Numbers(3);
  for (int y = 0; y < 40; ++y) Colour(&image, y, y % 3);
  for (int c = 0; c < 3; ++c) image.at(5, 100, c) = 60;
  Paint(Stem(0) + ".png", image);
  const StatusOr<Annotations> read = Read();
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->images[0].labels.at(5, 100), 255);
  EXPECT_THAT(warnings_, testing::Contains(HasSubstr("1 pixels with mixed colours")));
}

TEST_F(AnnotationsTest, ReportsAllFaults) {
  Paint("nobody.png", Numbers());
  Paint(Stem(0) + ".png", ByteImage(8, 8, 1, 0));
  Paint(Stem(1) + ".png", Numbers());
  Paint(Stem(1) + "_label.png", Numbers());
  WriteText(folder_ + "/painted/" + Stem(2) + ".png", "not a picture");
  const std::string message = Message();
  EXPECT_THAT(message, HasSubstr("nobody.png: found a name that matches no image of the scene"));
  EXPECT_THAT(message, HasSubstr("8 x 8 pixels, expected 160 x 120 (the size of its image)"));
  EXPECT_THAT(message, HasSubstr("a second annotation of the image of"));
  EXPECT_THAT(message, HasSubstr(Stem(2) + ".png: byte 0"));
}

TEST_F(AnnotationsTest, RejectsFewerThanTwoClasses) {
  Paint(Stem(0) + ".png", Numbers(1, 0));
  EXPECT_THAT(Message(), HasSubstr("found 1 class with at least 20 annotated pixels in 1 image, expected at least 2"));
}

TEST_F(AnnotationsTest, WarnsOfClassesWithoutAnnotation) {
  ByteImage image = Numbers(1, 0);
  Row(&image, 7, {1});
  Paint(Stem(0) + ".png", image);
  EXPECT_TRUE(Read().ok());
  EXPECT_THAT(warnings_, testing::Contains(HasSubstr("class roof has 0 annotated pixels")));
}

TEST_F(AnnotationsTest, RejectsAMissingFolder) {
  EXPECT_THAT(std::string(ReadAnnotations(folder_ + "/none", scene_, &warnings_).status().message()),
              HasSubstr("no such folder, expected a folder of annotations"));
}

}  // namespace
}  // namespace tessera
