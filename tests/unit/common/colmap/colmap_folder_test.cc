// Which model of a folder is read, and its comparison with rigs and frames.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstring>
#include <filesystem>

#include "absl/strings/str_cat.h"
#include "common/colmap/colmap.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// A model of images that look along z from (-x, 0, 0), one for each x. Image i has id i + 1 and name i.jpg.
struct RowOfImages {
  std::vector<double> xs;
  double focal_px = 500;

  void WriteText(const std::string& folder) const {
    fs::create_directories(folder);
    std::string images;
    for (size_t i = 0; i < xs.size(); ++i) {
      absl::StrAppend(&images, i + 1, " 1 0 0 0 ", xs[i], " 0 0 1 ", i, ".jpg\n\n");
    }
    tessera::WriteText(folder + "/cameras.txt", absl::StrCat("1 PINHOLE 640 480 ", focal_px, " 510 320 240\n"));
    tessera::WriteText(folder + "/images.txt", images);
  }
  void WriteBinary(const std::string& folder) const {
    fs::create_directories(folder);
    std::string cameras, images;
    const auto put = [](std::string& file, auto... values) {
      (file.append(reinterpret_cast<const char*>(&values), sizeof values), ...);
    };
    put(cameras, uint64_t{1}, uint32_t{1}, int32_t{1}, uint64_t{640}, uint64_t{480}, focal_px, 510.0, 320.0, 240.0);
    put(images, uint64_t{xs.size()});
    for (size_t i = 0; i < xs.size(); ++i) {
      put(images, static_cast<uint32_t>(i + 1), 1.0, 0.0, 0.0, 0.0, xs[i], 0.0, 0.0, uint32_t{1});
      images.append(absl::StrCat(i, ".jpg")).append(1, '\0');
      put(images, uint64_t{0});
    }
    tessera::WriteText(folder + "/cameras.bin", cameras);
    tessera::WriteText(folder + "/images.bin", images);
  }
};

void SetAge(const std::string& folder, const std::string& extension, int hours) {
  for (const char* stem : {"/cameras", "/images"}) {
    fs::last_write_time(folder + stem + extension, fs::file_time_type::clock::now() - std::chrono::hours(hours));
  }
}

struct FolderResult {
  CalibratedImages model;
  std::vector<std::string> faults;
  Warnings warnings;
};
FolderResult Read(const std::string& folder) {
  FolderResult result;
  Faults faults;
  result.model =
      ReadColmapModel(folder, CalibrationContent::kCamerasAndPoints, &faults, AllowedFiles::All(), &result.warnings);
  result.faults = faults.messages();
  return result;
}

TEST(ColmapFolderTest, ReadsTheOnlySubModel) {
  for (const std::string name : {"0", "3", "sparse", "sparse/0"}) {
    const std::string folder = FreshTestFolder("m");
    RowOfImages{{1, 2}}.WriteText(absl::StrCat(folder, "/", name));
    const FolderResult result = Read(folder);
    EXPECT_THAT(result.faults, IsEmpty());
    EXPECT_EQ(result.model.images.size(), 2u);
    EXPECT_THAT(result.model.files, ElementsAre(name + "/cameras.txt", name + "/images.txt"));
    EXPECT_THAT(result.warnings,
                ElementsAre(AllOf(HasSubstr(folder + ": has no model itself"),
                                  HasSubstr(absl::StrCat("that of ", name, " is used, with 2 images")))));
  }
}

TEST(ColmapFolderTest, ReadsTheSubModelWithMostImages) {
  const std::string folder = FreshTestFolder("m");
  RowOfImages{{1}}.WriteText(folder + "/0");
  RowOfImages{{1, 2, 3}}.WriteBinary(folder + "/1");
  RowOfImages{{1, 2}}.WriteText(folder + "/sparse/0");
  const FolderResult result = Read(folder);
  EXPECT_THAT(result.faults, IsEmpty());
  EXPECT_EQ(result.model.images.size(), 3u);
  EXPECT_THAT(result.model.files, ElementsAre("1/cameras.bin", "1/images.bin"));
  EXPECT_THAT(result.warnings, ElementsAre(HasSubstr("that of 1 is used, with 3 images"),
                                           HasSubstr("not used: 0 (1 images), sparse/0 (2 images)")));
}

TEST(ColmapFolderTest, AModelOfItsOwnHasPrecedence) {
  const std::string folder = FreshTestFolder("m");
  RowOfImages{{1}}.WriteText(folder);
  RowOfImages{{1, 2, 3}}.WriteText(folder + "/0");
  const FolderResult result = Read(folder);
  EXPECT_EQ(result.model.images.size(), 1u);
  EXPECT_THAT(result.warnings, IsEmpty());
}

TEST(ColmapFolderTest, NoModelIsAFault) {
  const std::string folder = FreshTestFolder("m");
  EXPECT_THAT(Read(folder).faults, ElementsAre(HasSubstr("found neither cameras.bin nor cameras.txt")));
}

TEST(ColmapFolderTest, EqualFormsAreReadAsBinary) {
  const std::string folder = FreshTestFolder("m");
  RowOfImages{{1, 2}}.WriteBinary(folder);
  RowOfImages{{1.0004, 2}, 500.001}.WriteText(folder);  // rounded
  SetAge(folder, ".bin", 5);
  const FolderResult result = Read(folder);
  EXPECT_THAT(result.faults, IsEmpty());
  EXPECT_THAT(result.warnings, IsEmpty());
  EXPECT_EQ(result.model.images[0].translation_cam_from_world.x(), 1);
  EXPECT_THAT(result.model.files, ElementsAre("cameras.bin", "images.bin"));
}

TEST(ColmapFolderTest, OfFormsThatDifferTheNewerIsRead) {
  const std::string folder = FreshTestFolder("m");
  RowOfImages{{1, 2}}.WriteBinary(folder);
  RowOfImages{{1, 12}, 510}.WriteText(folder);
  SetAge(folder, ".bin", 5);
  const FolderResult text = Read(folder);
  EXPECT_EQ(text.model.images[1].translation_cam_from_world.x(), 12);
  EXPECT_THAT(text.model.files, ElementsAre("cameras.txt", "images.txt"));
  EXPECT_THAT(text.warnings,
              ElementsAre(AllOf(HasSubstr("differ by up to 10.000 m and 0.000 degrees of an image and 10.00 px"),
                                HasSubstr("the text model is used, because its files are newer"))));
  SetAge(folder, ".txt", 9);
  const FolderResult binary = Read(folder);
  EXPECT_EQ(binary.model.images[1].translation_cam_from_world.x(), 2);
  EXPECT_THAT(binary.warnings, ElementsAre(HasSubstr("the binary model is used")));
  RowOfImages{{1, 2, 3}}.WriteText(folder);
  EXPECT_THAT(Read(folder).warnings, ElementsAre(HasSubstr("1 images are in one only")));
}

TEST(ColmapFolderTest, FaultsOfTheOtherTextModelAreAWarning) {
  const std::string folder = FreshTestFolder("m");
  RowOfImages{{1, 2}}.WriteBinary(folder);
  RowOfImages{{1, 2}}.WriteText(folder);
  WriteText(folder + "/cameras.txt", "1 FOV 640 480 1 1 1 1 1\n");
  const FolderResult result = Read(folder);
  EXPECT_THAT(result.faults, IsEmpty());
  EXPECT_THAT(result.warnings,
              ElementsAre(AllOf(HasSubstr("the binary model is used"), HasSubstr("camera model FOV"))));
}

TEST(ColmapFolderTest, NamesLfsPointers) {
  const std::string folder = FreshTestFolder("m");
  RowOfImages{{1, 2}}.WriteBinary(folder);
  WriteText(folder + "/cameras.bin", "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345678\n");
  EXPECT_THAT(Read(folder).faults,
              ElementsAre(AllOf(HasSubstr("cameras.bin: found a Git LFS pointer"), HasSubstr("git lfs pull"))));
}

// Two cameras in a rig, the second 0.5 m beside the first; a frame for each pair of images.
void WriteRig(const std::string& folder, const std::string& frames) {
  RowOfImages{{1, 1.5, 2, 2.5}}.WriteText(folder);
  WriteText(folder + "/cameras.txt", "1 PINHOLE 640 480 500 500 320 240\n2 PINHOLE 640 480 500 500 320 240\n");
  WriteText(folder + "/images.txt",
            "1 1 0 0 0 1 0 0 1 0.jpg\n\n2 1 0 0 0 1.5 0 0 2 1.jpg\n\n"
            "3 1 0 0 0 2 0 0 1 2.jpg\n\n4 1 0 0 0 2.5 0 0 2 3.jpg\n\n");
  WriteText(folder + "/rigs.txt", "# rigs\n9 2 CAMERA 1 CAMERA 2 1 1 0 0 0 0.5 0 0\n");
  WriteText(folder + "/frames.txt", frames);
}

TEST(ColmapFolderTest, PosesOfFramesMayRepeatThoseOfImages) {
  const std::string folder = FreshTestFolder("m");
  WriteRig(folder, "1 9 1 0 0 0 1 0 0 2 CAMERA 1 1 CAMERA 2 2\n2 9 1 0 0 0 2 0 0 2 CAMERA 1 3 CAMERA 2 4\n");
  const FolderResult result = Read(folder);
  EXPECT_THAT(result.faults, IsEmpty());
  EXPECT_THAT(result.warnings, IsEmpty());
  EXPECT_THAT(result.model.files, ElementsAre("cameras.txt", "images.txt"));
}

TEST(ColmapFolderTest, OtherPosesOfFramesAreAFault) {
  const std::string folder = FreshTestFolder("m");
  WriteRig(folder, "1 9 1 0 0 0 1 0 0 2 CAMERA 1 1 CAMERA 2 2\n2 9 1 0 0 0 2 0 1.25 2 CAMERA 1 3 CAMERA 2 4\n");
  EXPECT_THAT(Read(folder).faults,
              ElementsAre(AllOf(HasSubstr("images.txt: image '2.jpg': found a camera centre of (-2.000, "),
                                HasSubstr("expected (-2.000, "), HasSubstr("-1.250) as in frames.txt"),
                                HasSubstr("1.250 m and 0.000 degrees"), HasSubstr("2 of 4 images differ"),
                                HasSubstr("export the model again"))));
}

TEST(ColmapFolderTest, UnreadableFramesAreAWarning) {
  const std::string folder = FreshTestFolder("m");
  WriteRig(folder, "1 9 1 0 0 0\n");
  const FolderResult result = Read(folder);
  EXPECT_THAT(result.faults, IsEmpty());
  EXPECT_EQ(result.model.images.size(), 4u);
  EXPECT_THAT(result.warnings, ElementsAre(AllOf(HasSubstr("are not compared with those of frames.txt"),
                                                 HasSubstr("frames.txt: line 1"))));
}

}  // namespace
}  // namespace tessera
