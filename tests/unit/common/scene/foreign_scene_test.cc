// Images, models and meshes as other programs and systems write them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "common/base/parallel.h"
#include "common/imaging/image_io.h"
#include "common/check/check.h"
#include "common/scene/scene.h"
#include "tests/support/quad_mesh.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;

namespace fs = std::filesystem;

// Replaces the name of an image in the model.
void RenameInModel(const std::string& folder, const std::string& from, const std::string& to) {
  ReplaceInFile(folder + "/colmap/images.txt", " " + from + "\n", " " + to + "\n");
}

// The message of `tessera check` for the scene in this folder.
std::string FaultsOfScene(const std::string& folder) {
  Warnings warnings;
  const StatusOr<SceneSummary> summary = CheckSceneFolder(folder, &warnings, {});
  if (summary.ok()) return "";
  EXPECT_EQ(summary.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(summary.status().message());
}

TEST(SceneTest, FindsImagesByTheNamesOfOtherSystems) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  RenameInModel(folder, "view0.png", "./view0.png");
  fs::create_directory(folder + "/images/north");
  fs::create_directory(folder + "/likelihoods/north");
  fs::rename(folder + "/images/view1.png", folder + "/images/north/view1.png");
  fs::rename(folder + "/likelihoods/view1.tif", folder + "/likelihoods/north/view1.tif");
  RenameInModel(folder, "view1.png", "north\\view1.png");
  fs::rename(folder + "/images/view2.png", folder + "/images/View2.PNG");
  fs::rename(folder + "/images/view3.png", folder + "/images/Stra\u00dfe 3.png");
  fs::rename(folder + "/likelihoods/view3.tif", folder + "/likelihoods/Stra\u00dfe 3.tif");
  RenameInModel(folder, "view3.png", "Stra\u00dfe 3.png");
  Warnings warnings;
  const StatusOr<SceneDescription> scene = LoadScene(folder, &warnings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->views[0].image_path, "images/Stra\u00dfe 3.png");
  EXPECT_EQ(scene->views[1].image_path, "images/View2.PNG");
  EXPECT_EQ(scene->views[1].likelihood_path, "likelihoods/view2.tif");
  EXPECT_EQ(scene->views[2].name, "north/view1.png");
  EXPECT_EQ(scene->views[2].likelihood_path, "likelihoods/north/view1.tif");
  EXPECT_EQ(scene->views[3].name, "view0.png");
  EXPECT_THAT(warnings, testing::ElementsAre(AllOf(HasSubstr("images: 1 images have files whose names differ"),
                                                   HasSubstr("'View2.PNG' for 'view2.png'"))));
  EXPECT_EQ(FaultsOfScene(folder), "");
}

TEST(SceneTest, AnExactNameHasPrecedence) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  fs::copy(folder + "/images/view2.png", folder + "/images/VIEW2.png");
  EXPECT_EQ(FaultsOfScene(folder), "");
  fs::rename(folder + "/images/view2.png", folder + "/images/View2.png");
  EXPECT_THAT(FaultsOfScene(folder), AllOf(HasSubstr("images/view2.png: found no such file"),
                                           HasSubstr("'VIEW2.png' and 'View2.png' differ from 'view2.png'")));
}

TEST(SceneTest, TwoNamesOfOneFileAreAFault) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  RenameInModel(folder, "view1.png", "./view2.png");
  const std::string text = FaultsOfScene(folder);
  EXPECT_THAT(text, HasSubstr("images/view2.png: found one file for the images './view2.png' and 'view2.png'"));
  EXPECT_THAT(text, testing::Not(HasSubstr("likelihoods")));
}

TEST(SceneTest, ImagesMayDifferInTheirExtensionsOnly) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  fs::rename(folder + "/images/view1.png", folder + "/images/view2.jpg");  // the content decides the format
  RenameInModel(folder, "view1.png", "view2.jpg");
  EXPECT_THAT(FaultsOfScene(folder),
              HasSubstr("likelihoods/view2.tif: found one name for the likelihoods of 'view2.jpg' and 'view2.png', "
                        "expected a file for each, such as 'view2.jpg.tif'"));
  fs::rename(folder + "/likelihoods/view1.tif", folder + "/likelihoods/view2.jpg.tif");
  EXPECT_THAT(FaultsOfScene(folder), HasSubstr("likelihoods/view2.tif: found one name"));
  fs::rename(folder + "/likelihoods/view2.tif", folder + "/likelihoods/view2.png.tif");
  Warnings warnings;
  const StatusOr<SceneDescription> scene = LoadScene(folder, &warnings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->views[1].likelihood_path, "likelihoods/view2.jpg.tif");
  EXPECT_EQ(scene->views[2].likelihood_path, "likelihoods/view2.png.tif");
  EXPECT_EQ(std::set<std::string>(scene->files.begin(), scene->files.end()).size(), scene->files.size());
  EXPECT_THAT(ViewStems(*scene), testing::ElementsAre("view0", "view2.jpg", "view2.png", "view3", "view4"));
}

TEST(SceneTest, ManyMissingImagesAreOneFault) {
  const std::string folder = FreshTestFolder("scene");
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kNone;
  WriteTinyScene(folder, options);
  std::string images;
  for (int i = 1; i <= 600; ++i) absl::StrAppend(&images, i, " 1 0 0 0 0 0 0 1 strip/DJI_", 1000 + i, ".JPG\n");
  WriteText(folder + "/colmap/images.txt", images);
  Faults faults;
  LoadSceneCollecting(folder, {}, nullptr, &faults);
  ASSERT_EQ(faults.messages().size(), 1u);
  EXPECT_THAT(faults.messages()[0],
              AllOf(HasSubstr("images: found no files of 600 of the 600 images: strip/DJI_1001.JPG, "),
                    HasSubstr("strip/DJI_1020.JPG and 580 more, expected a file for each image"),
                    HasSubstr("set 'images' in scene.json")));
  EXPECT_LT(faults.messages()[0].size(), 1200u);
  fs::copy(folder + "/images/view0.png", folder + "/images/dji_1007.jpg");
  Faults hinted;
  LoadSceneCollecting(folder, {}, nullptr, &hinted);
  EXPECT_THAT(hinted.messages(),
              testing::ElementsAre(HasSubstr("the images folder has 'dji_1007.jpg' for 'strip/DJI_1007.JPG'")));
}

TEST(SceneTest, ModelInASubFolder) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  fs::create_directories(folder + "/colmap/sparse/0");
  for (const char* file : {"cameras.txt", "images.txt", "points3D.txt"}) {
    fs::rename(folder + "/colmap/" + file, folder + "/colmap/sparse/0/" + file);
  }
  Warnings warnings;
  const StatusOr<SceneDescription> scene = LoadScene(folder, &warnings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(scene->files, Contains("colmap/sparse/0/images.txt"));
  EXPECT_THAT(warnings, testing::ElementsAre("colmap: has no model itself; that of sparse/0 is used, with 5 images"));
  const StatusOr<SceneSummary> summary = CheckSceneFolder(folder, &warnings, {});
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_TRUE(summary->tie_points.has_value());
}

TEST(SceneTest, FaultsOfTheModelAddNoWarnings) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  ReplaceInFile(folder + "/colmap/cameras.txt", "OPENCV", "OPENCV_FISHEYE");
  Warnings warnings;
  const StatusOr<SceneSummary> summary = CheckSceneFolder(folder, &warnings, {});
  EXPECT_THAT(std::string(summary.status().message()), HasSubstr("found camera model OPENCV_FISHEYE"));
  EXPECT_THAT(warnings, IsEmpty());
}

TEST(SceneTest, ImagesWithoutLinesOfPoints) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  std::string poses;
  const std::vector<std::string> lines = absl::StrSplit(ReadText(folder + "/colmap/images.txt"), '\n');
  for (size_t i = 1; i < lines.size(); i += 2) absl::StrAppend(&poses, lines[i], "\n");  // after a comment
  WriteText(folder + "/colmap/images.txt", poses);
  fs::remove(folder + "/colmap/points3D.txt");
  EXPECT_EQ(FaultsOfScene(folder), "");
  Warnings warnings;
  EXPECT_EQ(LoadScene(folder, &warnings)->views.size(), 5u);
}

TEST(SceneTest, MeshesOfOtherProgramsAreTheSameMesh) {
  const std::string folder = FreshTestFolder("scene");
  const TinyScene tiny = WriteTinyScene(folder);
  const std::string faces = std::to_string(tiny.mesh.faces.size()), quads = std::to_string(tiny.mesh.faces.size() / 2);
  const std::string split = "mesh.ply: " + quads + " faces of more than 3 vertices split into " + faces + " triangles";
  for (const bool obj : {false, true}) {
    WriteText(folder + "/mesh.ply", obj ? QuadObj(tiny.mesh) : QuadPly(tiny.mesh));
    Warnings warnings;
    const StatusOr<SceneDescription> scene = LoadScene(folder, &warnings);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_EQ(scene->mesh_has_labels, !obj);
    const StatusOr<TriangleMesh> mesh = LoadSceneMesh(*scene, 0.2, &warnings);
    ASSERT_TRUE(mesh.ok()) << mesh.status();
    EXPECT_EQ(mesh->faces, tiny.mesh.faces);
    EXPECT_EQ(mesh->labels, obj ? std::vector<int32_t>() : tiny.mesh.labels);
    EXPECT_THAT(warnings, Contains(HasSubstr(split)));
    Warnings of_check;
    const StatusOr<SceneSummary> summary = CheckSceneFolder(folder, &of_check, {});
    ASSERT_TRUE(summary.ok()) << summary.status();
    EXPECT_EQ(of_check, warnings);
  }
}

TEST(SceneTest, LabelsOfVerticesAreLabels) {
  const std::string folder = FreshTestFolder("scene");
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kNone;
  const TinyScene tiny = WriteTinyScene(folder, options);
  WriteText(folder + "/mesh.ply", VertexLabelPly(tiny.mesh));
  Warnings warnings;
  const StatusOr<SceneDescription> scene = LoadScene(folder, &warnings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_TRUE(scene->mesh_has_labels);
  EXPECT_EQ(scene->classes.size(), 3u);
  const StatusOr<TriangleMesh> mesh = LoadSceneMesh(*scene, 0.2, &warnings);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  EXPECT_EQ(mesh->labels.size(), tiny.mesh.faces.size());
  EXPECT_THAT(warnings, Contains(HasSubstr("mesh.ply: labels are those of the vertices ('scalar_Label')")));
}

TEST(SceneTest, LabelPropertyChoosesOrRemovesTheLabels) {
  const std::string folder = FreshTestFolder("scene");
  const TinyScene tiny = WriteTinyScene(folder);
  WriteText(folder + "/mesh.ply", QuadPly(tiny.mesh));
  ReplaceInFile(folder + "/mesh.ply", "category_id", "classification");
  ReplaceInFile(folder + "/mesh.ply", " 0.000000", " 6.000000");
  EXPECT_THAT(FaultsOfScene(folder),
              HasSubstr("found label 6, expected 0 to 2 (index into classes), or -1 for no label; if 'classification' "
                        "holds no labels, set \"label_property\": null in scene.json"));
  const std::string json = ReadText(folder + "/scene.json");
  ReplaceInFile(folder + "/scene.json", "\"crs\"", "\"label_property\": null, \"crs\"");
  EXPECT_EQ(FaultsOfScene(folder), "");
  WriteText(folder + "/scene.json", json);
  ReplaceInFile(folder + "/scene.json", "\"crs\"", "\"label_property\": \"kind\", \"crs\"");
  EXPECT_THAT(FaultsOfScene(folder), HasSubstr("mesh.ply: header: found no property 'kind'"));
  ReplaceInFile(folder + "/mesh.ply", "classification", "kind");
  ReplaceInFile(folder + "/mesh.ply", " 6.000000", " 0.000000");
  EXPECT_EQ(FaultsOfScene(folder), "");
}

}  // namespace
}  // namespace tessera
