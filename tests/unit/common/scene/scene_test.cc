#include "common/scene/scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "common/base/parallel.h"
#include "common/check/check.h"
#include "common/imaging/image_io.h"
#include "tests/support/quad_mesh.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;

namespace fs = std::filesystem;

// The message of `tessera check` for the scene in this folder.
std::string FaultText(const std::string& folder) {
  Warnings warnings;
  const StatusOr<SceneSummary> summary = CheckSceneFolder(folder, &warnings, {});
  if (summary.ok()) return "";
  EXPECT_EQ(summary.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(summary.status().message());
}

TEST(SceneTest, RoundTrip) {
  const std::string folder = FreshTestFolder("scene");
  const TinyScene tiny = WriteTinyScene(folder);
  Warnings warnings;
  for (const std::string& path : {folder, folder + "/", folder + "/scene.json"}) {
    const StatusOr<SceneDescription> scene = LoadScene(path, &warnings);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_THAT(warnings, IsEmpty());
    ASSERT_EQ(scene->views.size(), tiny.cameras.size());
    EXPECT_EQ(scene->views[2].name, "view2.png");
    EXPECT_EQ(scene->views[2].image_path, "images/view2.png");
    EXPECT_EQ(scene->views[2].likelihood_path, "likelihoods/view2.tif");
    EXPECT_LT((scene->views[2].camera.Centre() - tiny.cameras[2].Centre()).norm(), 1e-9);
    EXPECT_TRUE(scene->has_likelihoods);
    EXPECT_EQ(scene->classes.size(), 3u);
    EXPECT_EQ(scene->up_in_local, Eigen::Vector3d::UnitZ());
    EXPECT_EQ(scene->files.size(), 1u + 2 + 5 + 5 + 1);
    EXPECT_TRUE(std::is_sorted(scene->files.begin(), scene->files.end()));
    for (const std::string& file : scene->files) EXPECT_TRUE(fs::exists(folder + "/" + file)) << file;
    const StatusOr<TriangleMesh> mesh = LoadSceneMesh(*scene, 0.2);
    ASSERT_TRUE(mesh.ok()) << mesh.status();
    EXPECT_EQ(mesh->faces, tiny.mesh.faces);
    EXPECT_EQ(mesh->labels, tiny.mesh.labels);
    EXPECT_NEAR(*MedianGsd(*scene, *mesh), 0.2, 0.03);
  }
}

// Programs number the same images differently. The order of the views decides how sums over views round.
TEST(SceneTest, ViewsAreSortedByNameWhateverTheirIds) {
  const std::string folder = FreshTestFolder("scene");
  const TinyScene tiny = WriteTinyScene(folder);
  const std::string path = folder + "/colmap/images.txt", images = ReadText(path);
  // "1 QW ..." becomes "9 QW ...": the first image gets the last id.
  const size_t first = images.find("\n1 ");
  ASSERT_NE(first, std::string::npos);
  WriteText(path, std::string(images).replace(first, 3, "\n9 "));
  Warnings warnings;
  const StatusOr<SceneDescription> scene = LoadScene(folder, &warnings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->views.size(), tiny.cameras.size());
  for (size_t v = 0; v < tiny.cameras.size(); ++v) {
    EXPECT_EQ(scene->views[v].name, tiny.image_names[v]);
    EXPECT_LT((scene->views[v].camera.Centre() - tiny.cameras[v].Centre()).norm(), 1e-9);
  }
}

TEST(SceneTest, ProjectionsDoNotDependOnTheCrs) {
  const TinyScene tiny = MakeTinyScene();
  for (const char* crs : {R"({"type": "utm", "zone": 32, "north": true})", R"({"type": "local"})"}) {
    TinySceneOptions options;
    options.offset = {444140.25, 5784706.5, 40};
    options.crs_json = crs;
    const std::string folder = FreshTestFolder("scene");
    WriteTinyScene(folder, options);
    Warnings warnings;
    const StatusOr<SceneDescription> scene = LoadScene(folder, &warnings);
    ASSERT_TRUE(scene.ok()) << scene.status();
    const StatusOr<TriangleMesh> mesh = LoadSceneMesh(*scene, 0.2);
    ASSERT_TRUE(mesh.ok()) << mesh.status();
    for (size_t i = 0; i < mesh->vertices.size(); ++i) {
      EXPECT_LT(mesh->vertices[i].norm(), 2000);
      // Compare the projections of a vertex in the images.
      for (size_t v = 0; v < scene->views.size(); ++v) {
        const Eigen::Vector3d here = scene->views[v].camera.Project(mesh->vertices[i]);
        ASSERT_LT((here - tiny.cameras[v].Project(tiny.mesh.vertices[i])).norm(), 1e-5);
      }
    }
  }
}

TEST(SceneTest, SceneWithoutLikelihoodsAndLabelsHasOneClass) {
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kNone;
  options.labels = false;
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder, options);
  WriteText(folder + "/scene.json", R"({"tessera_scene": 1, "up": [0, 0, 2]})");
  Warnings warnings;
  const StatusOr<SceneDescription> scene = LoadScene(folder, &warnings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->classes.size(), 1u);
  EXPECT_FALSE(scene->has_likelihoods);
  EXPECT_EQ(FaultText(folder), "");
}

TEST(SceneTest, FlightsByPattern) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  const std::string head = R"({"tessera_scene": 1, "classes": ["ground", "facade", "roof"], "flights": )";
  WriteText(folder + "/scene.json",
            head + R"([{"name": "a", "images": ["*2.png", "view4*"]}, {"name": "b"}, {"name": "c"}]})");
  Warnings warnings;
  const StatusOr<SceneDescription> scene = LoadScene(folder, &warnings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->views[2].flight, 0);
  EXPECT_EQ(scene->views[3].flight, 1);
  EXPECT_EQ(scene->views[4].flight, 0);
  EXPECT_THAT(warnings, Contains(HasSubstr("flight 'c' has no image")));
  WriteText(folder + "/scene.json", head + R"([{"name": "a", "images": ["*2.png"]}]})");
  EXPECT_THAT(FaultText(folder), HasSubstr("no flight with image 'view3.png'"));
}

TEST(CheckTest, GoodScenesPassInEveryForm) {
  using Likelihoods = TinySceneOptions::Likelihoods;
  for (const Likelihoods form : {Likelihoods::kTiff, Likelihoods::kNpy, Likelihoods::kLabelPng, Likelihoods::kNone}) {
    TinySceneOptions options;
    options.likelihoods = form;
    options.k1 = form == Likelihoods::kNpy ? -0.1 : 0;
    const std::string folder = FreshTestFolder("scene");
    WriteTinyScene(folder, options);
    Warnings warnings;
    const StatusOr<SceneSummary> summary = CheckSceneFolder(folder, &warnings, {});
    ASSERT_TRUE(summary.ok()) << summary.status();
    EXPECT_THAT(warnings, IsEmpty());
    EXPECT_EQ(summary->images, 5);
    EXPECT_NEAR(summary->surface_m2, 40 * 40 + 4 * 12 * 8, 1e-6);
    EXPECT_NEAR(summary->extent_m2, 1600, 1e-6);
    EXPECT_NEAR(summary->classes[1].area_share, 384.0 / 1984, 1e-9);
    EXPECT_LT(summary->unseen_share, 0.2);
    ASSERT_TRUE(summary->tie_points.has_value());
    EXPECT_GT(summary->tie_points->observations, 100);
    EXPECT_LT(summary->tie_points->median_px, 1e-3);
    EXPECT_EQ(summary->tie_points->inside_share, 1);
    EXPECT_THAT(SummaryToText(*summary), HasSubstr("160 x 120"));
    EXPECT_THAT(SummaryToJson(*summary, warnings), HasSubstr("\"gsd_m\": 0."));
  }
}

TEST(CheckTest, SummaryDoesNotDependOnThreads) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  const auto run = [&](int threads) {
    const ThreadLimit limit(threads);
    Warnings warnings;
    return SummaryToJson(*CheckSceneFolder(folder, &warnings, {}), warnings);
  };
  EXPECT_EQ(run(1), run(2));
}

TEST(CheckTest, ReturnsCancelled) {
  const std::string folder = FreshTestFolder("scene");
  WriteTinyScene(folder);
  Warnings warnings;
  TaskControl control;
  control.cancelled = [] { return true; };
  EXPECT_EQ(CheckSceneFolder(folder, &warnings, control).status().code(), absl::StatusCode::kCancelled);
}

// Each kind of invalid input, and parts of its expected message.
struct BadInput {
  const char* name;
  void (*spoil)(const std::string& folder, const TinyScene& scene);
  std::vector<const char*> said;
};

class BadInputTest : public testing::TestWithParam<BadInput> {};

TEST_P(BadInputTest, IsNamed) {
  const std::string folder = FreshTestFolder("scene");
  const TinyScene scene = WriteTinyScene(folder);
  GetParam().spoil(folder, scene);
  const std::string text = FaultText(folder);
  for (const char* said : GetParam().said) EXPECT_THAT(text, HasSubstr(said));
}

const BadInput kBadInputs[] = {
    {"NoScene",
     [](const std::string& f, const TinyScene&) { fs::remove(f + "/scene.json"); },
     {"scene.json: found no such file"}},
    {"UnreadableJson",
     [](const std::string& f, const TinyScene&) { ReplaceInFile(f + "/scene.json", "],", "]"); },
     {"scene.json: line 4, column"}},
    {"UnknownKey",
     [](const std::string& f, const TinyScene&) { ReplaceInFile(f + "/scene.json", "classes", "clases"); },
     {"unknown key 'clases'"}},
    {"GivenButAbsent",
     [](const std::string& f, const TinyScene&) {
       ReplaceInFile(f + "/scene.json", "\"crs\"", "\"likelihoods\": \"lik\", \"crs\"");
     },
     {"lik: found no such folder"}},
    {"GivenMeshAbsent",
     [](const std::string& f, const TinyScene&) {
       ReplaceInFile(f + "/scene.json", "\"crs\"", "\"mesh\": \"m.ply\", \"crs\"");
     },
     {"m.ply: found no such file"}},
    {"MissingImage",
     [](const std::string& f, const TinyScene&) { fs::remove(f + "/images/view1.png"); },
     {"images/view1.png: found no such file"}},
    {"MissingLikelihood",
     [](const std::string& f, const TinyScene&) { fs::remove(f + "/likelihoods/view1.tif"); },
     {"likelihoods/view1: found no .tif"}},
    {"EmptyImage",
     [](const std::string& f, const TinyScene&) { WriteText(f + "/images/view1.png", ""); },
     {"images/view1.png: byte 0: found an empty file"}},
    {"LfsPointers",
     [](const std::string& f, const TinyScene&) {
       for (const char* file : {"/images/view1.png", "/likelihoods/view2.tif", "/mesh.ply"}) {
         WriteText(f + file, "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 123456\n");
       }
     },
     {"images/view1.png: found a Git LFS pointer", "likelihoods/view2.tif: found a Git LFS pointer",
      "mesh.ply: found a Git LFS pointer", "run 'git lfs pull'"}},
    {"NoImagesFolder",
     [](const std::string& f, const TinyScene&) { fs::remove_all(f + "/images"); },
     {"images: found no files of 5 of the 5 images: view0.png, view1.png"}},
    {"ImageOfAnotherSize",
     [](const std::string& f, const TinyScene&) {
       EXPECT_TRUE(WritePng(f + "/images/view1.png", ByteImage(80, 60)).ok());
     },
     {"view1.png: found 80 x 60 pixels, expected 160 x 120"}},
    {"DamagedImage",
     [](const std::string& f, const TinyScene&) { fs::resize_file(f + "/images/view1.png", 2000); },
     {"view1.png: found a damaged PNG image"}},
    {"ImageOutsideTheFolder",
     [](const std::string& f, const TinyScene&) {
       ReplaceInFile(f + "/colmap/images.txt", "view1.png", "../view1.png");
     },
     {"the name '../view1.png'"}},
    {"WrongPageCount",
     [](const std::string& f, const TinyScene&) {
       EXPECT_TRUE(WriteLikelihoodTiff(f + "/likelihoods/view1.tif", ByteImage(160, 120, 2, 9)).ok());
     },
     {"view1.tif: found 2 pages, expected 3"}},
    {"NanLikelihood",
     [](const std::string& f, const TinyScene&) {
       fs::remove(f + "/likelihoods/view1.tif");
       const std::string header = "{'descr': '<f2', 'fortran_order': False, 'shape': (3, 30, 40), }\n";
       std::string npy("\x93NUMPY\x01\x00", 8);
       npy += static_cast<char>(header.size());
       npy += '\0';
       npy += header + std::string(3 * 30 * 40 * 2, '\0');
       npy[npy.size() - 1] = '\x7e';  // the last value becomes NaN
       WriteText(f + "/likelihoods/view1.npy", npy);
     },
     {"view1.npy: class 2, pixel (39, 29): found NaN"}},
    {"TwoLikelihoodFiles",
     [](const std::string& f, const TinyScene&) { WriteText(f + "/likelihoods/view1.npy", ""); },
     {"likelihoods/view1: found 2 files, expected one"}},
    {"UnknownCameraModel",
     [](const std::string& f, const TinyScene&) {
       ReplaceInFile(f + "/colmap/cameras.txt", "OPENCV", "OPENCV_FISHEYE");
     },
     {"cameras.txt: line 2: found camera model OPENCV_FISHEYE"}},
    {"DuplicateImageId",
     [](const std::string& f, const TinyScene&) { ReplaceInFile(f + "/colmap/images.txt", "\n3 ", "\n2 "); },
     {"images.txt: line 6: found image 2 again"}},
    {"NoCameras",
     [](const std::string& f, const TinyScene&) { fs::remove_all(f + "/colmap"); },
     {"colmap: found no such folder"}},
    {"CameraBehindTheMesh",
     [](const std::string& f, const TinyScene&) {
       // Below the ground, looking up (identity rotation).
       ReplaceInFile(f + "/colmap/images.txt", "# two lines an image\n",
                     "# two lines an image\n9 1 0 0 0 0 0 40 1 below.png\n\n");
       fs::copy(f + "/images/view1.png", f + "/images/below.png");
       fs::copy(f + "/likelihoods/view1.tif", f + "/likelihoods/below.tif");
     },
     {"image 'below.png': found mostly backs of faces: its camera is behind the mesh"}},
    {"CameraThatSeesNothing",
     [](const std::string& f, const TinyScene&) {
       ReplaceInFile(f + "/colmap/images.txt", "# two lines an image\n",
                     "# two lines an image\n9 1 0 0 0 0 0 -40 1 sky.png\n\n");
       fs::copy(f + "/images/view1.png", f + "/images/sky.png");
       fs::copy(f + "/likelihoods/view1.tif", f + "/likelihoods/sky.tif");
     },
     {"image 'sky.png': found no face in front of its camera"}},
    {"CamerasOfAnotherScene",
     [](const std::string& f, const TinyScene&) {
       // Changes every z coordinate.
       const std::string text = ReadText(f + "/colmap/points3D.txt");
       WriteText(f + "/colmap/points3D.txt", absl::StrReplaceAll(text, {{" 128 128 128", "9 128 128 128"}}));
     },
     {"expected cameras that fit their 3D points"}},
    {"TruncatedPly",
     [](const std::string& f, const TinyScene&) {
       fs::resize_file(f + "/mesh.ply", fs::file_size(f + "/mesh.ply") - 5);
     },
     {"mesh.ply: byte "}},
    {"FaceIndexOutOfRange",
     [](const std::string& f, const TinyScene& scene) {
       TriangleMesh mesh = scene.mesh;
       mesh.faces[5][1] = 100000;
       WriteText(f + "/mesh.ply", AsciiPly(mesh, "double"));
     },
     {"mesh.ply: line ", "100000"}},
    {"LabelOutOfRange",
     [](const std::string& f, const TinyScene& scene) {
       TriangleMesh mesh = scene.mesh;
       mesh.labels[5] = 3;
       WriteText(f + "/mesh.ply", AsciiPly(mesh, "double"));
     },
     {"mesh.ply: face 5: found label 3, expected 0 to 2"}},
    {"MeshIsALfsPointer",
     [](const std::string& f, const TinyScene&) {
       WriteText(f + "/mesh.ply", "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 1234\n");
     },
     {"mesh.ply: ", "found a Git LFS pointer in place of the file", "run 'git lfs pull'"}},
    {"MeshIsStl",
     [](const std::string& f, const TinyScene&) {
       WriteText(f + "/mesh.ply", "solid cube\nfacet normal 0 0 1\nendsolid\n");
     },
     {"mesh.ply: first bytes: found a text STL file, expected a mesh file (PLY, OBJ, glTF): convert it"}},
    {"TwoLabelProperties",
     [](const std::string& f, const TinyScene& scene) {
       WriteText(f + "/mesh.ply", QuadPly(scene.mesh));
       ReplaceInFile(f + "/mesh.ply", "property float category_id", "property float category_id\nproperty int class");
     },
     {"mesh.ply: line 10: found face properties 'category_id' and 'class'", "\"label_property\""}},
};

INSTANTIATE_TEST_SUITE_P(Each, BadInputTest, testing::ValuesIn(kBadInputs),
                         [](const testing::TestParamInfo<BadInput>& entry) { return std::string(entry.param.name); });

TEST(CheckTest, ReportsAllFaults) {
  const std::string folder = FreshTestFolder("scene");
  const TinyScene scene = WriteTinyScene(folder);
  fs::remove(folder + "/images/view1.png");
  EXPECT_TRUE(WriteLikelihoodTiff(folder + "/likelihoods/view3.tif", ByteImage(160, 120, 2, 9)).ok());
  TriangleMesh mesh = scene.mesh;
  mesh.labels[7] = 9;
  WriteText(folder + "/mesh.ply", AsciiPly(mesh, "double"));
  EXPECT_THAT(FaultText(folder), AllOf(HasSubstr("view1.png"), HasSubstr("view3.tif"), HasSubstr("label 9")));
}

TEST(CheckTest, RejectsFloatMeshesWithTooLargeRounding) {
  TinySceneOptions options;
  options.offset = {444140.25, 5784706.5, 40};
  options.crs_json = R"({"type": "utm", "zone": 32})";
  const std::string folder = FreshTestFolder("scene");
  const TinyScene scene = WriteTinyScene(folder, options);
  EXPECT_EQ(FaultText(folder), "");
  WriteText(folder + "/mesh.ply", AsciiPly(scene.mesh, "float"));
  EXPECT_THAT(FaultText(folder),
              AllOf(HasSubstr("mesh.ply: header: found x, y, z as 32-bit floats"), HasSubstr("5.78473e+06")));
  const std::string near = FreshTestFolder("near");
  const TinyScene small = WriteTinyScene(near);
  WriteText(near + "/mesh.ply", AsciiPly(small.mesh, "float"));
  EXPECT_EQ(FaultText(near), "");
}

TEST(CheckTest, DefectsOfTheMeshAreWarnings) {
  const std::string folder = FreshTestFolder("scene");
  const TinyScene scene = WriteTinyScene(folder);
  TriangleMesh mesh = scene.mesh;
  mesh.faces.push_back({mesh.faces[0][0], mesh.faces[0][0], mesh.faces[0][1]});
  mesh.labels.push_back(0);
  WriteText(folder + "/mesh.ply", AsciiPly(mesh, "double"));
  Warnings warnings;
  ASSERT_TRUE(CheckSceneFolder(folder, &warnings, {}).ok());
  EXPECT_EQ(warnings.size(), 1u);
}

}  // namespace
}  // namespace tessera
