// Scenes in a map projection, from their files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "common/scene/scene.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::HasSubstr;

StatusOr<SceneDescription> LoadProjected(const std::string& crs_json, const Eigen::Vector3d& offset,
                                         Warnings* warnings) {
  TinySceneOptions options;
  options.offset = offset;
  options.crs_json = crs_json;
  const std::string folder = FreshTestFolder("projected");
  WriteTinyScene(folder, options);
  return LoadScene(folder, warnings);
}

TEST(ProjectedSceneTest, LoadsAsUtmDoes) {
  const TinyScene tiny = MakeTinyScene();
  const Eigen::Vector3d offset(444140.25, 5784706.5, 40);
  Warnings warnings;
  const StatusOr<SceneDescription> scene = LoadProjected(
      R"({"type": "projected", "epsg": 25832}, "source": {"crs": "EPSG:25832", "offset": [444000, 5784000, 0]})",
      offset, &warnings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const StatusOr<SceneDescription> utm = LoadProjected(R"({"type": "utm", "zone": 32})", offset, &warnings);
  ASSERT_TRUE(utm.ok()) << utm.status();
  EXPECT_EQ(scene->frame.origin_in_scene(), utm->frame.origin_in_scene());
  ASSERT_EQ(scene->views.size(), utm->views.size());
  for (size_t v = 0; v < scene->views.size(); ++v) EXPECT_EQ(scene->views[v].camera, utm->views[v].camera);
  const Eigen::Vector3d p(10, 20, 30);
  const StatusOr<Eigen::Vector3d> g = scene->frame.GeodeticFromLocal(p);
  ASSERT_TRUE(g.ok()) << g.status();
  EXPECT_LT((*g - *utm->frame.GeodeticFromLocal(p)).head<2>().norm() * 6.4e6, 0.001);  // ETRS89 is WGS 84 to PROJ
  ASSERT_TRUE(scene->source.has_value());
  EXPECT_EQ(scene->source->crs, "EPSG:25832");
  EXPECT_EQ(scene->source->offset, Eigen::Vector3d(444000, 5784000, 0));
  EXPECT_FALSE(utm->source.has_value());
}

TEST(ProjectedSceneTest, WrongSystemsAreNamed) {
  Warnings warnings;
  EXPECT_THAT(std::string(LoadProjected(R"({"type": "projected", "epsg": 999999})", {444140, 5784706, 40}, &warnings)
                              .status()
                              .message()),
              HasSubstr("EPSG:999999"));
  EXPECT_THAT(
      std::string(
          LoadProjected(R"({"type": "projected", "epsg": 25832})", {4e8, 5784706, 40}, &warnings).status().message()),
      HasSubstr("EPSG:25832"));
}

}  // namespace
}  // namespace tessera
