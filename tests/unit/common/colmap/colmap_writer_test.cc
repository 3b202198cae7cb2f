#include "common/colmap/colmap_writer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <initializer_list>

#include "absl/strings/str_cat.h"
#include "common/colmap/colmap.h"
#include "tests/support/blocks/truth_block.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using Kind = LensModel::Kind;

LensModel WrittenLens(Kind kind, double fy, std::initializer_list<double> coefficients) {
  LensModel lens;
  lens.kind = kind;
  lens.pinhole = {4000, 3000, 3400.1, fy, 2000.0 / 3, 1500.7};
  std::copy(coefficients.begin(), coefficients.end(), lens.coefficients);
  return lens;
}

// The model with each observation of the block, image i with id i + 1 and point i with id 2 i.
CalibratedImages ModelOf(const ImportedBlock& block) {
  CalibratedImages model;
  for (size_t k = 0; k < block.cameras.size(); ++k) model.cameras[static_cast<uint32_t>(k)] = block.cameras[k].lens;
  for (size_t k = 0; k < block.images.size(); ++k) {
    const BlockImage& image = block.images[k];
    model.images.push_back({static_cast<uint32_t>(k + 1),
                            image.path,
                            static_cast<uint32_t>(image.camera),
                            image.rotation_cam_from_block,
                            -image.rotation_cam_from_block * image.centre,
                            {}});
  }
  for (size_t k = 0; k < block.points.size(); ++k) {
    model.points.push_back({2 * k, block.points[k].position, {}});
    for (const BlockObservation& observation : block.points[k].observations) {
      model.images[observation.image].observations.push_back({observation.position_px, 2 * k});
    }
  }
  return model;
}

TEST(ColmapWriterTest, ReadsBackTheSameNumbers) {
  TruthOptions options;
  options.lens = Kind::kBrown;
  options.centre = {651234.125, 6861000.3, 40};
  options.square_pixels = false;
  const CalibratedImages model = ModelOf(MakeTruthBlock(options));
  const std::string folder = FreshTestFolder("model");
  ASSERT_TRUE(WriteColmapModel(model, folder).ok());
  Faults faults;
  const CalibratedImages read = ReadColmapModel(folder, CalibrationContent::kCamerasAndPoints, &faults);
  EXPECT_THAT(faults.messages(), IsEmpty());
  EXPECT_EQ(read.cameras, model.cameras);
  ASSERT_EQ(read.images.size(), model.images.size());
  for (size_t i = 0; i < read.images.size(); ++i) {
    const CalibratedImage &a = read.images[i], &b = model.images[i];
    EXPECT_EQ(a.name, b.name);
    EXPECT_EQ(a.camera_id, b.camera_id);
    EXPECT_LT((a.rotation_cam_from_world - b.rotation_cam_from_world).norm(), 1e-14);
    EXPECT_EQ(a.translation_cam_from_world, b.translation_cam_from_world);
    ASSERT_EQ(a.observations.size(), b.observations.size());
    for (size_t k = 0; k < a.observations.size(); ++k) {
      EXPECT_EQ(a.observations[k].position_px, b.observations[k].position_px);
      EXPECT_EQ(a.observations[k].point_id, b.observations[k].point_id);
    }
  }
  ASSERT_EQ(read.points.size(), model.points.size());
  for (size_t i = 0; i < read.points.size(); ++i) {
    EXPECT_EQ(read.points[i].id, model.points[i].id);
    EXPECT_EQ(read.points[i].position, model.points[i].position);
    for (const uint32_t id : read.points[i].image_ids) EXPECT_THAT(id, testing::Ge(1u));
  }
}

// Tracks name the image point by its position in the image's list.
TEST(ColmapWriterTest, TracksFollowTheObservations) {
  CalibratedImages model;
  model.cameras[3] = WrittenLens(Kind::kPinhole, 3400.1, {});
  model.points = {{5, {1, 2, 3}, {}}, {9, {4, 5, 6}, {}}};
  model.images.push_back({1, "a b.jpg", 3, Eigen::Matrix3d::Identity(), {0, 0, 0}, {{{10, 20}, 9}, {{30, 40.5}, 5}}});
  model.images.push_back({7, "c.jpg", 3, Eigen::Matrix3d::Identity(), {0.1, 0, 0}, {}});
  model.images.push_back({8, "d.jpg", 3, Eigen::Matrix3d::Identity(), {1, 0, 0}, {{{1, 2}, 9}}});
  const std::string folder = FreshTestFolder("model");
  ASSERT_TRUE(WriteColmapModel(model, folder).ok());
  EXPECT_THAT(ReadText(folder + "/images.txt"),
              HasSubstr("\n1 1 0 0 0 0 0 0 3 a b.jpg\n10 20 9 30 40.5 5\n7 1 0 0 0 0.1"
                        " 0 0 3 c.jpg\n\n8 "));
  EXPECT_THAT(ReadText(folder + "/points3D.txt"),
              HasSubstr("\n5 1 2 3 128 128 128 -1 1 1\n9 4 5 6 128 128 128 -1 1 0 8 0\n"));
}

TEST(ColmapWriterTest, EachCameraHasTheSimplestModel) {
  const struct {
    const char* model;
    LensModel lens;
  } cases[] = {
      {"SIMPLE_PINHOLE", WrittenLens(Kind::kPinhole, 3400.1, {})},
      {"SIMPLE_PINHOLE", WrittenLens(Kind::kBrown, 3400.1, {})},
      {"PINHOLE", WrittenLens(Kind::kFullOpenCv, 3400, {})},
      {"SIMPLE_RADIAL", WrittenLens(Kind::kBrown, 3400.1, {0.1})},
      {"RADIAL", WrittenLens(Kind::kOpenCv, 3400.1, {0.1, 0.2})},
      {"RADIAL", WrittenLens(Kind::kOpenCv, 3400.1, {0, 0.2})},
      {"OPENCV", WrittenLens(Kind::kRadial, 3400, {0.1})},
      {"OPENCV", WrittenLens(Kind::kBrown, 3400.1, {0.1, 0, 0, 0.01})},
      {"FULL_OPENCV", WrittenLens(Kind::kBrown, 3400.1, {0, 0, 0, 0, 0.3})},
      {"FULL_OPENCV", WrittenLens(Kind::kFullOpenCv, 3400.1, {0.1, 0.2, 0.01, 0.02, 0.3, 0, 0, 0.4})},
      {"TESSERA_BROWN", WrittenLens(Kind::kBrown, 3400.1, {0.1, 0.2, 0.01, 0.02, 0.3, 0.4})},
      {"TESSERA_BROWN", WrittenLens(Kind::kBrown, 3400, {0, 0, 0, 0, 0, 0, 1.5})},
  };
  CalibratedImages model;
  for (size_t i = 0; i < std::size(cases); ++i) model.cameras[static_cast<uint32_t>(i + 1)] = cases[i].lens;
  const std::string folder = FreshTestFolder("model");
  ASSERT_TRUE(WriteColmapModel(model, folder).ok());
  const std::string text = ReadText(folder + "/cameras.txt");
  Faults faults;
  CalibratedImages read = ReadColmapModel(folder, CalibrationContent::kCamerasAndPoints, &faults);
  EXPECT_THAT(faults.messages(), IsEmpty());
  ASSERT_EQ(read.cameras.size(), std::size(cases));
  for (size_t i = 0; i < std::size(cases); ++i) {
    EXPECT_THAT(text, HasSubstr(absl::StrCat("\n", i + 1, " ", cases[i].model, " 4000 3000 ")));
    const LensModel& lens = read.cameras[static_cast<uint32_t>(i + 1)];
    EXPECT_EQ(lens.pinhole, cases[i].lens.pinhole);
    EXPECT_EQ(lens.Distort({10, 20}), cases[i].lens.Distort({10, 20})) << cases[i].model;
  }
}

TEST(ColmapWriterTest, RefusesWhatTheReaderWouldMisread) {
  CalibratedImages model;
  model.cameras[1] = WrittenLens(Kind::kPinhole, 3400.1, {});
  model.images.push_back({1, "a.jpg", 1, Eigen::Matrix3d::Identity(), {0, 0, 0}, {{{1, 2}, 4}}});
  const std::string folder = FreshTestFolder("model");
  EXPECT_THAT(std::string(WriteColmapModel(model, folder).message()), HasSubstr("observation of point 4"));
  model.images[0].observations.clear();
  for (const char* name : {"a\nb.jpg", " a.jpg", "a.jpg ", ""}) {
    model.images[0].name = name;
    EXPECT_THAT(std::string(WriteColmapModel(model, folder).message()), HasSubstr("a name without line breaks"));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder));
}

}  // namespace
}  // namespace tessera
