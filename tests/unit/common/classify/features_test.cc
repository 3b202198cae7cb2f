#include "common/classify/features.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "absl/strings/str_cat.h"
#include "common/base/random.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

int FeatureNamed(const std::string& name) {
  const auto& names = FeatureNames();
  const auto it = std::find(names.begin(), names.end(), name);
  EXPECT_NE(it, names.end()) << name;
  return static_cast<int>(it - names.begin());
}

// A camera 50 m above the origin, tilted from the nadir towards +y; up points to the top of the image.
SceneView Looking(double angle_rad, int width = 60, int height = 44) {
  SceneView view;
  view.lens.pinhole = {width, height, 50, 50, width / 2.0, height / 2.0};
  view.camera.intrinsics = view.lens.pinhole;
  const Eigen::Vector3d forward(0, std::sin(angle_rad), -std::cos(angle_rad)), right(1, 0, 0);
  view.camera.rotation_cam_from_world.row(0) = right;
  view.camera.rotation_cam_from_world.row(1) = forward.cross(right);
  view.camera.rotation_cam_from_world.row(2) = forward;
  view.camera.translation_cam_from_world = -view.camera.rotation_cam_from_world * Eigen::Vector3d(0, 0, 50);
  return view;
}

ByteImage Noise(int width, int height) {
  ByteImage rgb(width, height, 3);
  Random random(5);
  for (uint8_t& value : rgb.data) value = static_cast<uint8_t>(random.Below(256));
  return rgb;
}

std::vector<float> Pixel(const ImageFeatures& features, int x, int y) {
  std::vector<float> pixel(FeatureCount());
  features.Row(x, y, 1, 1, pixel.data());
  return pixel;
}

double Light(const ByteImage& rgb, int x, int y) {
  return std::sqrt((0.299 * rgb.at(x, y, 0) + 0.587 * rgb.at(x, y, 1) + 0.114 * rgb.at(x, y, 2)) / 255);
}
double Green(const ByteImage& rgb, int x, int y) {
  const double r = rgb.at(x, y, 0), g = rgb.at(x, y, 1), b = rgb.at(x, y, 2);
  return (2 * g - r - b) / (r + g + b + 6);
}

// Level `level` of the pyramid around pixel (x, y), computed directly: binomial weights 1 4 6 4 1, reflected border.
double Blurred(const std::function<double(int, int)>& value, int width, int height, int level, int x, int y) {
  if (level == 0) return value(x, y);
  const auto reflected = [](int i, int n) { return i < 0 ? -i : i >= n ? 2 * n - 2 - i : i; };
  int w = width, h = height;
  for (int l = 1; l < level; ++l) w = (w + 1) / 2, h = (h + 1) / 2;
  constexpr double kWeights[5] = {1 / 16.0, 4 / 16.0, 6 / 16.0, 4 / 16.0, 1 / 16.0};
  double sum = 0;
  for (int j = -2; j <= 2; ++j) {
    for (int i = -2; i <= 2; ++i) {
      sum += kWeights[i + 2] * kWeights[j + 2] *
             Blurred(value, width, height, level - 1, reflected(2 * x + i, w), reflected(2 * y + j, h));
    }
  }
  return sum;
}

TEST(FeaturesTest, NamesAreUniqueAndMatchTheFeatureCount) {
  std::vector<std::string> names = FeatureNames();
  EXPECT_EQ(static_cast<int>(names.size()), FeatureCount());
  EXPECT_EQ(names[AppearanceFeatureCount()], "up_normal") << "features of the mesh come last";
  std::sort(names.begin(), names.end());
  EXPECT_EQ(std::unique(names.begin(), names.end()), names.end());
}

TEST(FeaturesTest, MeansAndDeviationsEqualNaiveSums) {
  const ByteImage rgb = Noise(60, 44);
  const ImageFeatures features(rgb, Looking(0.7), Eigen::Vector3d::UnitZ(), nullptr);
  const auto light = [&](int x, int y) { return Light(rgb, x, y); };
  const auto green = [&](int x, int y) { return Green(rgb, x, y); };
  const auto squared = [](auto value) { return [=](int x, int y) { return value(x, y) * value(x, y); }; };
  for (const int level : {1, 2, 3}) {
    const std::string suffix = absl::StrCat("_", level);
    // At a position where a pixel of the level coincides with one of the image, and half way between two.
    for (const auto& [x, y] : {std::pair{2, 1}, {0, 0}, {4, 3}}) {
      const std::vector<float> pixel = Pixel(features, x << level, y << level);
      const double mean = Blurred(light, 60, 44, level, x, y), of_green = Blurred(green, 60, 44, level, x, y);
      EXPECT_NEAR(pixel[FeatureNamed("light" + suffix)], mean, 1e-5);
      EXPECT_NEAR(pixel[FeatureNamed("greenness" + suffix)], of_green, 1e-5);
      EXPECT_NEAR(pixel[FeatureNamed("light_deviation" + suffix)],
                  std::sqrt(Blurred(squared(light), 60, 44, level, x, y) - mean * mean), 1e-4);
      EXPECT_NEAR(pixel[FeatureNamed("greenness_deviation" + suffix)],
                  std::sqrt(Blurred(squared(green), 60, 44, level, x, y) - of_green * of_green), 1e-4);
      const std::vector<float> between = Pixel(features, (2 * x + 1) << (level - 1), y << level);
      EXPECT_NEAR(between[FeatureNamed("light" + suffix)], 0.5 * (mean + Blurred(light, 60, 44, level, x + 1, y)),
                  1e-5);
    }
  }
  const std::vector<float> pixel = Pixel(features, 17, 9);
  EXPECT_NEAR(pixel[FeatureNamed("light")], Light(rgb, 17, 9), 1e-5);
  EXPECT_NEAR(pixel[FeatureNamed("greenness")], Green(rgb, 17, 9), 1e-5);
}

TEST(FeaturesTest, RowEqualsSinglePixels) {
  const ByteImage rgb = Noise(60, 44);
  const ImageFeatures features(rgb, Looking(0.7), Eigen::Vector3d::UnitZ(), nullptr);
  constexpr int kStride = 40;
  std::vector<float> row(static_cast<size_t>(FeatureCount()) * kStride);
  features.Row(13, 21, 33, kStride, row.data());
  for (int i = 0; i < 33; ++i) {
    const std::vector<float> pixel = Pixel(features, 13 + i, 21);
    for (int f = 0; f < FeatureCount(); ++f) ASSERT_EQ(row[f * kStride + i], pixel[f]) << FeatureNames()[f];
  }
}

// Bands perpendicular to the up direction have a gradient along it.
TEST(FeaturesTest, GradientsAreRelativeToUp) {
  for (const bool along : {true, false}) {
    ByteImage rgb(60, 44, 3);
    for (int y = 0; y < 44; ++y) {
      for (int x = 0; x < 60; ++x) {
        for (int c = 0; c < 3; ++c) rgb.at(x, y, c) = (along ? y : x) / 3 % 2 ? 200 : 60;
      }
    }
    const ImageFeatures oblique(rgb, Looking(1.2), Eigen::Vector3d::UnitZ(), nullptr);
    const float up = Pixel(oblique, 30, 20)[FeatureNamed("gradient_up_3")];
    EXPECT_NEAR(up, along ? 1 : -1, 0.1);
    // The same camera in a rotated frame: up is +x, along the image's rows.
    const ImageFeatures tilted(rgb, Looking(1.2), Eigen::Vector3d::UnitX(), nullptr);
    EXPECT_NEAR(Pixel(tilted, 30, 20)[FeatureNamed("gradient_up_3")], along ? -1 : 1, 0.1);
  }
}

TEST(FeaturesTest, MeshFeaturesMatchTheMesh) {
  const TinyScene tiny = MakeTinyScene();  // a box of 8 m on flat ground
  const MeshSurface surface(tiny.mesh, Eigen::Vector3d::UnitZ(), 0.2);
  const int up = FeatureNamed("up_normal"), height = FeatureNamed("above_ground_10m");
  int seen[3] = {};
  for (size_t v = 0; v < tiny.cameras.size(); ++v) {
    SceneView view;
    view.camera = tiny.cameras[v];
    view.lens.pinhole = tiny.cameras[v].intrinsics;
    const LabelImage& labels = tiny.label_pictures[v];
    const ImageFeatures features(ByteImage(labels.width, labels.height, 3, 100), view, Eigen::Vector3d::UnitZ(),
                                 &surface);
    for (int y = 2; y + 2 < labels.height; y += 3) {
      for (int x = 2; x + 2 < labels.width; x += 3) {
        const uint8_t label = labels.at(x, y);
        const std::vector<float> pixel = Pixel(features, x, y);
        if (label == 255) {
          EXPECT_EQ(pixel[up], 0);
          EXPECT_FALSE(features.LocationOf(x, y, 1).ground_m.has_value());
          continue;
        }
        ++seen[label];
        EXPECT_NEAR(pixel[up], label == 1 ? 0 : 1, 1e-3);
        if (label != 1) {
          EXPECT_NEAR(pixel[height], label == 0 ? 0 : 8, 0.01);
        }
      }
    }
  }
  for (const int of_class : seen) EXPECT_GT(of_class, 100);
}

}  // namespace
}  // namespace tessera
