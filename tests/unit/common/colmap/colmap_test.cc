#include "common/colmap/colmap.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "common/base/random.h"
#include "common/colmap/colmap_entries.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr auto kAll = CalibrationContent::kCamerasAndPoints;

std::vector<std::string> TextFaults(const std::string& cameras, const std::string& images,
                                    const std::string& points = "", CalibratedImages* model = nullptr) {
  CalibratedImages own;
  Faults faults;
  ParseColmapText(cameras, images, points, "m", kAll, model == nullptr ? &own : model, &faults);
  return faults.messages();
}

const char kCamera[] = "1 PINHOLE 640 480 500 510 320 240\n";
const char kImage[] = "1 1 0 0 0 0.5 0.25 2 1 a b.jpg\n10 20 7 30 40 -1\n";

TEST(ColmapTextTest, ReadsEveryModel) {
  CalibratedImages model;
  EXPECT_THAT(TextFaults("# comment\n\n1 SIMPLE_PINHOLE 640 480 500 320 240\r\n2 PINHOLE 640 480 500 510 320 240\n"
                         "3 SIMPLE_RADIAL 640 480 500 320 240 0.1\n4 RADIAL 640 480 500 320 240 0.1 0.2\n"
                         "5 OPENCV 640 480 500 510 320 240 0.1 0.2 0.3 0.4\n"
                         "6 FULL_OPENCV 640 480 500 510 320 240 0.1 0.2 0.3 0.4 0.5 0.6 0.7 0.8\n"
                         "7 OPENCV 640 480 500 510 320 240 0 0 0 0",
                         "", "", &model),
              IsEmpty());
  ASSERT_EQ(model.cameras.size(), 7u);
  EXPECT_EQ(model.cameras[1].pinhole.fy, 500);
  EXPECT_EQ(model.cameras[2].pinhole.fy, 510);
  EXPECT_EQ(model.cameras[2].pinhole.cx, 320);
  EXPECT_EQ(model.cameras[3].kind, LensModel::Kind::kSimpleRadial);
  EXPECT_EQ(model.cameras[3].coefficients[0], 0.1);
  EXPECT_EQ(model.cameras[3].coefficients[1], 0);
  EXPECT_EQ(model.cameras[4].coefficients[1], 0.2);
  EXPECT_EQ(model.cameras[5].kind, LensModel::Kind::kOpenCv);
  EXPECT_EQ(model.cameras[5].coefficients[3], 0.4);
  for (int k = 0; k < 8; ++k) EXPECT_DOUBLE_EQ(model.cameras[6].coefficients[k], 0.1 * (k + 1));
  EXPECT_EQ(model.cameras[7].kind, LensModel::Kind::kPinhole);  // nothing to undistort
}

// Of an imported camera that COLMAP's models do not cover. Binary models have no id for it.
TEST(ColmapTextTest, ReadsTesseraBrown) {
  CalibratedImages model;
  EXPECT_THAT(TextFaults("1 TESSERA_BROWN 640 480 500 510 320 240 0.1 0.2 0.3 0.4 0.5 0.6 0.7\n", "", "", &model),
              IsEmpty());
  ASSERT_EQ(model.cameras.size(), 1u);
  EXPECT_EQ(model.cameras[1].kind, LensModel::Kind::kBrown);
  EXPECT_EQ(model.cameras[1].pinhole, (PinholeCamera{640, 480, 500, 510, 320, 240}));
  for (int k = 0; k < 7; ++k) EXPECT_DOUBLE_EQ(model.cameras[1].coefficients[k], 0.1 * (k + 1));
  EXPECT_EQ(FindColmapCameraModel(-1), nullptr);
}

TEST(ColmapTextTest, ReadsImagesAndPoints) {
  CalibratedImages model;
  EXPECT_THAT(
      TextFaults(kCamera, std::string("9 0 2 0 0 1 2 3 1 z.jpg\n\n") + kImage, "7 1 2 3 0 0 0 0.5 1 0 9 4\n", &model),
      IsEmpty());
  ASSERT_EQ(model.images.size(), 2u);
  EXPECT_EQ(model.images[0].name, "a b.jpg");  // by id; names may have blanks
  ASSERT_EQ(model.images[0].observations.size(), 1u);
  EXPECT_EQ(model.images[0].observations[0].position_px, Eigen::Vector2d(10, 20));
  EXPECT_EQ(model.images[0].translation_cam_from_world, Eigen::Vector3d(0.5, 0.25, 2));
  // The quaternion (0, 2, 0, 0) is normalised to a rotation by 180 degrees about x.
  EXPECT_NEAR(
      (model.images[1].rotation_cam_from_world - Eigen::Vector3d(1, -1, -1).asDiagonal().toDenseMatrix()).norm(), 0,
      1e-12);
  ASSERT_EQ(model.points.size(), 1u);
  EXPECT_THAT(model.points[0].image_ids, ElementsAre(1, 9));
}

TEST(ColmapTextTest, EveryFaultNamesItsLine) {
  EXPECT_THAT(TextFaults("# a\n1 FOV 640 480 1 1 1 1 1\n2 NONSENSE 640 480 1\n", ""),
              ElementsAre(HasSubstr("m/cameras.txt: line 2: found camera model FOV, expected SIMPLE_PINHOLE"),
                          HasSubstr("m/cameras.txt: line 3: found camera model NONSENSE")));
  EXPECT_THAT(TextFaults(std::string(kCamera) + kCamera, ""),
              ElementsAre(HasSubstr("line 2: found camera 1 again, expected a unique id or name (first at line 1)")));
  EXPECT_THAT(
      TextFaults("1 PINHOLE 640 480 500 510 320\n", ""),
      ElementsAre(HasSubstr("line 1: found 3 parameters for camera 1 of model PINHOLE, expected 4 (fx fy cx cy)")));
  EXPECT_THAT(TextFaults("1 PINHOLE 640 480 500 x 320 240\n", ""), ElementsAre(HasSubstr("line 1: found 'x'")));
  EXPECT_THAT(TextFaults("1 PINHOLE 640 480 nan 510 320 240\n", ""), ElementsAre(HasSubstr("found parameter nan")));
  EXPECT_THAT(TextFaults("1 PINHOLE 640 480 -5 510 320 240\n", ""), ElementsAre(HasSubstr("found focal length -5")));
  EXPECT_THAT(TextFaults("1 PINHOLE 0 480 5 510 320 240\n", ""), ElementsAre(HasSubstr("an image of 0 x 480")));
  EXPECT_THAT(TextFaults("-1 PINHOLE 640 480 5 510 320 240\n", ""),
              ElementsAre(HasSubstr("found '-1', expected a camera id")));
  EXPECT_THAT(TextFaults(kCamera, std::string(kImage) + kImage),
              ElementsAre(HasSubstr("m/images.txt: line 3: found image 1 again")));
  EXPECT_THAT(TextFaults(kCamera, std::string(kImage) + "2 1 0 0 0 0 0 0 1 a b.jpg\n\n"),
              ElementsAre(HasSubstr("line 3: found image 'a b.jpg' again")));
  EXPECT_THAT(TextFaults(kCamera, "1 0 0 0 0 0 0 0 1 a.jpg\n\n"), ElementsAre(HasSubstr("quaternion (0, 0, 0, 0)")));
  EXPECT_THAT(TextFaults(kCamera, "1 1 0 0 0 0 0 0 4 a.jpg\n\n"),
              ElementsAre(HasSubstr("line 1: found camera 4 for image 'a.jpg'")));
  EXPECT_THAT(TextFaults(kCamera, "-1 1 0 0 0 0 0 0 1 a.jpg\n\n"),
              ElementsAre(HasSubstr("found '-1', expected an image id")));
  EXPECT_THAT(TextFaults(kCamera, "1 1 0 0 0 0 0 0 1\n\n"), ElementsAre(HasSubstr("found the end of the line")));
  EXPECT_THAT(TextFaults(kCamera, "1 1 0 0 0 0 0 0 1 a.jpg\n1 2\n"),
              ElementsAre(HasSubstr("line 2: found the end of the line")));
  EXPECT_THAT(TextFaults(kCamera, kImage, "1 1 2\n"), ElementsAre(HasSubstr("m/points3D.txt: line 1")));
}

// A pose for each name, with ids from 1, each followed by `after`.
std::string Poses(const std::vector<std::string>& names, const std::string& after) {
  std::string text;
  for (size_t i = 0; i < names.size(); ++i) {
    text += absl::StrCat(i + 1, " 1 0 0 0 ", i, " 0.25 2 1 ", names[i], "\n", after);
  }
  return text;
}
std::vector<std::string> NamesOf(const CalibratedImages& model) {
  std::vector<std::string> names;
  for (const CalibratedImage& image : model.images) names.push_back(image.name);
  return names;
}

TEST(ColmapTextTest, ReadsImagesWithoutLinesOfPoints) {
  const std::vector<std::string> names = {"a.jpg", "1", "2 3.jpg", "d e.jpg"};
  for (const char* after : {"", "\n", "# comment\n", "\n# comment\n\n", "# comment\n\n", " \t\r\n"}) {
    for (const CalibrationContent content : {CalibrationContent::kCameras, kAll}) {
      CalibratedImages model;
      Faults faults;
      ParseColmapText(kCamera, "# images\n" + Poses(names, after), "", "m", content, &model, &faults);
      EXPECT_THAT(faults.messages(), IsEmpty()) << after;
      EXPECT_EQ(NamesOf(model), names) << after;
    }
  }
}

TEST(ColmapTextTest, LinesOfWholeNumbersArePoints) {
  CalibratedImages model;
  EXPECT_THAT(
      TextFaults(kCamera, Poses({"a.jpg", "b.jpg"}, "# points\n10 20 7 30 40 8 50 60 9 70 80 10\n"), "", &model),
      IsEmpty());
  EXPECT_THAT(NamesOf(model), ElementsAre("a.jpg", "b.jpg"));
  ASSERT_EQ(model.images[1].observations.size(), 4u);
  EXPECT_EQ(model.images[1].observations[2].point_id, 9u);
}

TEST(ColmapTextTest, RefusesAMixtureOfImagesWithAndWithoutLinesOfPoints) {
  const std::string pose = "1 0 0 0 0 0 2 1 ";
  for (const CalibrationContent content : {CalibrationContent::kCameras, kAll}) {
    const auto faults = [&](const std::string& images) {
      CalibratedImages model;
      Faults found;
      ParseColmapText(kCamera, images, "", "m", content, &model, &found);
      return found.messages();
    };
    EXPECT_THAT(faults("1 " + pose + "a.jpg\n1 2 3\n2 " + pose + "b.jpg\n3 " + pose + "c.jpg\n1 2 3\n"),
                ElementsAre(AllOf(HasSubstr("m/images.txt: line 3: found no line of image points"),
                                  HasSubstr("line 2 has image points"))));
    EXPECT_THAT(faults("1 " + pose + "a.jpg\n2 " + pose + "b.jpg\n1 2 3\n3 " + pose + "c.jpg\n4 " + pose + "d.jpg\n"),
                ElementsAre(AllOf(HasSubstr("m/images.txt: line 3: found a line of image points"),
                                  HasSubstr("the image of line 1 has none"))));
  }
}

TEST(ColmapTextTest, AFaultyPoseIsNoLineOfPoints) {
  for (const CalibrationContent content : {CalibrationContent::kCameras, kAll}) {
    CalibratedImages model;
    Faults faults;
    ParseColmapText(kCamera, "1 1 0 0 0 0 0 2 1 a.jpg\n-2 1 0 0 0 0 0 2 1 b.jpg\n", "", "m", content, &model, &faults);
    EXPECT_THAT(faults.messages(), ElementsAre(HasSubstr("m/images.txt: line 2: found 'b.jpg'")));
  }
}

TEST(ColmapTextTest, TakesByteOrderMarksCarriageReturnsAndTabs) {
  const auto windows = [](const std::string& text) {
    return "\xef\xbb\xbf# list\r\n" + absl::StrReplaceAll(text, {{"\n", "\r\n"}, {" ", "\t"}});
  };
  CalibratedImages model;
  EXPECT_THAT(TextFaults(windows(kCamera), windows("1 1 0 0 0 5.0e-001 0.25 2 1 a.jpg\n10 20 7 30 40 -1 \n"),
                         windows("7 1 2 3 0 0 0 0.5 1 0\n"), &model),
              IsEmpty());
  EXPECT_THAT(NamesOf(model), ElementsAre("a.jpg"));
  EXPECT_EQ(model.images[0].translation_cam_from_world.x(), 0.5);
  EXPECT_EQ(model.images[0].observations.size(), 1u);
  EXPECT_EQ(model.points.size(), 1u);
  CalibratedImages unmarked;
  EXPECT_THAT(TextFaults("\xef\xbb\xbf" + std::string(kCamera), "\xef\xbb\xbf" + std::string(kImage), "", &unmarked),
              IsEmpty());
  EXPECT_THAT(NamesOf(unmarked), ElementsAre("a b.jpg"));
  EXPECT_THAT(TextFaults(std::string("\xff\xfe#\0", 4), kImage),
              ElementsAre(HasSubstr("m/cameras.txt: found a text in UTF-16, expected UTF-8")));
}

TEST(ColmapTextTest, NamesTheModelThatIsLikelyMeant) {
  EXPECT_THAT(TextFaults("4 SIMPLE_RADIAL 640 480 500 320 240 0.1 0\n", ""),
              ElementsAre(AllOf(HasSubstr("line 1: found 5 parameters for camera 4 of model SIMPLE_RADIAL, expected 4"),
                                HasSubstr("likely RADIAL (f cx cy k1 k2)"))));
  EXPECT_THAT(TextFaults("4 BROWN 640 480 500 320 240 0.1 0\n", ""),
              ElementsAre(AllOf(HasSubstr("found camera model BROWN with 5 parameters, likely RADIAL (f cx cy k1 k2)"),
                                HasSubstr("FULL_OPENCV"), HasSubstr("colmap image_undistorter"))));
}

TEST(ColmapTextTest, FaultsOfACameraCountIfAnImageHasIt) {
  const std::string unused = std::string(kCamera) + "77 SIMPLE_RADIAL 640 480 -nan(ind) 320 240 0\n78 FOV 640 480 1\n";
  CalibratedImages model;
  EXPECT_THAT(TextFaults(unused, kImage, "", &model), IsEmpty());
  EXPECT_EQ(model.cameras.size(), 1u);
  EXPECT_THAT(TextFaults(unused, "1 1 0 0 0 0 0 2 77 a.jpg\n\n2 1 0 0 0 0 0 2 77 b.jpg\n\n"),
              ElementsAre(HasSubstr("m/cameras.txt: line 2: found parameter nan")));
}

// Writes COLMAP's binary files.
class Writer {
 public:
  template <class T>
  Writer& Put(T value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
    return *this;
  }
  Writer& Name(const char* name) {
    bytes.append(name, std::strlen(name) + 1);
    return *this;
  }
  std::string bytes;
};

std::string BinaryCameras() {
  Writer w;
  w.Put<uint64_t>(2);
  w.Put<uint32_t>(1).Put<int32_t>(1).Put<uint64_t>(640).Put<uint64_t>(480).Put(500.0).Put(510.0).Put(320.0).Put(240.0);
  w.Put<uint32_t>(2).Put<int32_t>(2).Put<uint64_t>(64).Put<uint64_t>(48).Put(50.0).Put(32.0).Put(24.0).Put(0.1);
  return w.bytes;
}
std::string BinaryImages() {
  Writer w;
  w.Put<uint64_t>(2);
  w.Put<uint32_t>(9).Put(1.0).Put(0.0).Put(0.0).Put(0.0).Put(1.0).Put(2.0).Put(3.0).Put<uint32_t>(2).Name("b.jpg");
  w.Put<uint64_t>(0);
  w.Put<uint32_t>(4).Put(1.0).Put(0.0).Put(0.0).Put(0.0).Put(0.5).Put(0.25).Put(2.0).Put<uint32_t>(1).Name("a b.jpg");
  w.Put<uint64_t>(2).Put(10.0).Put(20.0).Put<uint64_t>(7).Put(30.0).Put(40.0).Put<uint64_t>(UINT64_MAX);
  return w.bytes;
}
std::string BinaryPoints() {
  Writer w;
  w.Put<uint64_t>(1).Put<uint64_t>(7).Put(1.0).Put(2.0).Put(3.0).Put<uint8_t>(0).Put<uint8_t>(0).Put<uint8_t>(0).Put(
      0.5);
  w.Put<uint64_t>(1).Put<uint32_t>(4).Put<uint32_t>(0);
  return w.bytes;
}

std::vector<std::string> BinaryFaults(const std::string& cameras, const std::string& images, const std::string& points,
                                      CalibratedImages* model = nullptr, CalibrationContent content = kAll) {
  CalibratedImages own;
  Faults faults;
  ParseColmapBinary(cameras, images, points, "m", content, model == nullptr ? &own : model, &faults);
  return faults.messages();
}

TEST(ColmapBinaryTest, EqualsTheTextReader) {
  for (const CalibrationContent content : {CalibrationContent::kCameras, kAll}) {
    CalibratedImages model;
    EXPECT_THAT(BinaryFaults(BinaryCameras(), BinaryImages(), BinaryPoints(), &model, content), IsEmpty());
    ASSERT_EQ(model.images.size(), 2u);
    EXPECT_EQ(model.images[0].name, "a b.jpg");
    EXPECT_EQ(model.images[0].translation_cam_from_world, Eigen::Vector3d(0.5, 0.25, 2));
    EXPECT_EQ(model.images[0].observations.size(), content == kAll ? 1u : 0u);
    EXPECT_EQ(model.cameras[1].pinhole.fy, 510);
    EXPECT_EQ(model.cameras[2].coefficients[0], 0.1);
    EXPECT_EQ(model.points.size(), content == kAll ? 1u : 0u);
  }
}

TEST(ColmapBinaryTest, RejectsEveryPrefixWithItsOffset) {
  const std::string cameras = BinaryCameras(), images = BinaryImages(), points = BinaryPoints();
  for (size_t n = 0; n < cameras.size(); ++n) {
    const auto faults = BinaryFaults(cameras.substr(0, n), images, points);
    ASSERT_FALSE(faults.empty()) << n;
    EXPECT_THAT(faults[0], HasSubstr("m/cameras.bin: byte "));
  }
  for (size_t n = 0; n < images.size(); ++n)
    EXPECT_FALSE(BinaryFaults(cameras, images.substr(0, n), points).empty()) << n;
  for (size_t n = 1; n < points.size(); ++n)
    EXPECT_FALSE(BinaryFaults(cameras, images, points.substr(0, n)).empty()) << n;
  EXPECT_THAT(BinaryFaults(cameras + "x", images, points), ElementsAre(HasSubstr("found 1 more bytes")));
}

TEST(ColmapBinaryTest, CorruptCountsAllocateNothing) {
  std::string cameras = BinaryCameras(), images = BinaryImages(), points = BinaryPoints();
  const uint64_t huge = UINT64_MAX / 2;
  for (std::string* file : {&cameras, &images, &points}) {
    const std::string good = *file;
    std::memcpy(file->data(), &huge, 8);
    EXPECT_THAT(BinaryFaults(cameras, images, points),
                testing::Contains(HasSubstr("byte 0: found 9223372036854775807 entries")));
    *file = good;
  }
  std::memcpy(images.data() + 8 + 4 + 56 + 4 + 6, &huge, 8);  // observations of the first image
  EXPECT_FALSE(BinaryFaults(cameras, images, points).empty());
}

TEST(ColmapBinaryTest, FlippedBytesNeverCrash) {
  const std::string files[] = {BinaryCameras(), BinaryImages(), BinaryPoints()};
  Random random(2);
  for (int i = 0; i < 3000; ++i) {
    std::string changed[] = {files[0], files[1], files[2]};
    for (int k = 0; k < 3; ++k) {
      std::string& file = changed[random.Below(3)];
      file[random.Below(static_cast<int64_t>(file.size()))] = static_cast<char>(random.Below(256));
    }
    BinaryFaults(changed[0], changed[1], changed[2]);
  }
}

TEST(ColmapBinaryTest, UnknownModelNamesItsNumber) {
  std::string cameras = BinaryCameras();
  cameras[12] = 77;
  EXPECT_THAT(BinaryFaults(cameras, "", ""), testing::Contains(HasSubstr("byte 8: found camera model 77")));
  // The cameras after it cannot be read; that is no second fault.
  EXPECT_THAT(BinaryFaults(cameras, BinaryImages(), ""), ElementsAre(HasSubstr("byte 8: found camera model 77")));
}

TEST(ColmapBinaryTest, ReadsOnAfterAnUnsupportedModel) {
  Writer cameras;
  cameras.Put<uint64_t>(2);
  cameras.Put<uint32_t>(2).Put<int32_t>(11).Put<uint64_t>(640).Put<uint64_t>(480);
  for (int k = 0; k < 16; ++k) cameras.Put(0.5);
  cameras.Put<uint32_t>(1).Put<int32_t>(1).Put<uint64_t>(640).Put<uint64_t>(480).Put(500.0).Put(510.0).Put(320.0).Put(
      240.0);
  CalibratedImages model;
  EXPECT_THAT(BinaryFaults(cameras.bytes, BinaryImages(), "", &model),
              ElementsAre(AllOf(HasSubstr("byte 8: found camera model RAD_TAN_THIN_PRISM_FISHEYE"),
                                HasSubstr("colmap image_undistorter"))));
  EXPECT_EQ(model.cameras.size(), 1u);
}

}  // namespace
}  // namespace tessera
