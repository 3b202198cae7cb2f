// `tessera import`: blocks of other programs become scenes, or are refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/blocks/block_format.h"
#include "common/meshio/ply.h"
#include "common/scene/scene.h"
#include "tests/e2e/programs.h"
#include "tests/support/blocks/named_block_errors.h"
#include "tests/support/blocks/write_blocks_exchange.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

const Eigen::Vector3d kShift(691200.25, 5334016.5, 520);  // a place in UTM zone 32

class ImportTest : public testing::Test {
 protected:
  ImportTest()
      : folder_(TempFolder::Create(testing::TempDir()).value()),
        block_(folder_.path() + "/block.xml"),
        mesh_(folder_.path() + "/Production_1"),
        scene_(folder_.path() + "/scene") {}

  // The toy city's model at `shift`, as another program on another machine writes it.
  ImportedBlock Block(const Eigen::Vector3d& shift = kShift) const {
    ImportedBlock block = ReadBlock(ToyCity() + "/colmap", "colmap", {}, nullptr).value();
    for (BlockImage& image : block.images) {
      image.path = "D:\\flights\\may\\" + image.path;
      image.centre += shift;
    }
    for (BlockTiePoint& point : block.points) point.position += shift;
    return block;
  }
  void WriteBlock(const ImportedBlock& block) const {
    ExchangeWriteOptions options;
    options.block_srs = "EPSG:32632";
    ASSERT_TRUE(WriteFileAtomic(block_, WriteBlocksExchange(block, options)).ok());
  }
  // The toy city's mesh as one OBJ tile, and the origin of its coordinates.
  void WriteMesh(const Eigen::Vector3d& origin) const {
    const TriangleMesh mesh = ReadPly(ToyCity() + "/mesh.ply").value().mesh;
    std::string obj;
    for (const Eigen::Vector3d& v : mesh.vertices)
      absl::StrAppendFormat(&obj, "v %.9f %.9f %.9f\n", v.x(), v.y(), v.z());
    const char* materials[] = {"Ground", "Wall", "Tiles", "Trees"};
    int32_t last = -1;
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      if (mesh.labels[f] != last) absl::StrAppend(&obj, "usemtl ", materials[last = mesh.labels[f]], "\n");
      const Triangle& face = mesh.faces[f];
      absl::StrAppend(&obj, "f ", face[0] + 1, " ", face[1] + 1, " ", face[2] + 1, "\n");
    }
    fs::create_directories(mesh_ + "/Data/Tile_+000_+000");
    ASSERT_TRUE(WriteFileAtomic(mesh_ + "/Data/Tile_+000_+000/Tile_+000_+000.obj", obj).ok());
    ASSERT_TRUE(WriteFileAtomic(mesh_ + "/metadata.xml",
                                absl::StrFormat("<?xml version=\"1.0\"?>\n<ModelMetadata version=\"1\"><SRS>EPSG:32632"
                                                "</SRS><SRSOrigin>%.17g,%.17g,%.17g</SRSOrigin></ModelMetadata>\n",
                                                origin.x(), origin.y(), origin.z()))
                    .ok());
  }
  // The file of --classes.
  std::string WriteClasses() const {
    const std::string classes = folder_.path() + "/classes.json";
    EXPECT_TRUE(
        WriteFileAtomic(classes, R"({"Ground": "ground", "Wall": "facade", "Tiles": "roof", "Trees": "vegetation"})")
            .ok());
    return classes;
  }
  Outcome Import(const std::vector<std::string>& more) const {
    std::vector<std::string> arguments = {"import", block_, "--out", scene_};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Tessera(folder_.path(), arguments);
  }

  const TempFolder folder_;
  const std::string block_, mesh_, scene_;
};

TEST_F(ImportTest, BlockAndTilesBecomeTheScene) {
  WriteBlock(Block());
  WriteMesh(kShift);
  const Outcome outcome = Import({"--images", ToyCity() + "/images", "--mesh", mesh_, "--frame", "grid", "--labels",
                                  "material", "--classes", WriteClasses(), "--flight", "may=*"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(outcome.output, AllOf(HasSubstr("proven on the tie points"), HasSubstr("tessera run")));

  Warnings warnings;
  const SceneDescription imported = LoadScene(scene_, &warnings).value(),
                         made = LoadScene(ToyCity(), &warnings).value();
  EXPECT_EQ(imported.frame.crs().kind, Crs::Kind::kUtm);
  ASSERT_EQ(imported.views.size(), made.views.size());
  for (const SceneView& expected : made.views) {
    const auto found = std::find_if(imported.views.begin(), imported.views.end(),
                                    [&](const SceneView& view) { return view.name == expected.name; });
    ASSERT_NE(found, imported.views.end()) << expected.name;
    const SceneView& got = *found;
    EXPECT_EQ(imported.flights[got.flight].name, "may");
    const Eigen::Vector3d centre = imported.frame.SceneFromLocal(got.camera.Centre()) - kShift;
    EXPECT_LT((centre - made.frame.SceneFromLocal(expected.camera.Centre())).norm(), 1e-6) << got.name;
    EXPECT_LT((got.camera.rotation_cam_from_world - expected.camera.rotation_cam_from_world).cwiseAbs().maxCoeff(),
              1e-9);
    EXPECT_NEAR(got.lens.pinhole.fx, expected.lens.pinhole.fx, 1e-9);
    EXPECT_NEAR(got.lens.pinhole.cx, expected.lens.pinhole.cx, 1e-9);
  }
  const TriangleMesh mesh = ReadPly(scene_ + "/mesh.ply").value().mesh,
                     start = ReadPly(ToyCity() + "/mesh.ply").value().mesh;
  EXPECT_EQ(mesh.labels, start.labels);
  ASSERT_EQ(mesh.vertices.size(), start.vertices.size());
  for (size_t i = 0; i < mesh.vertices.size(); ++i) {
    EXPECT_LT((mesh.vertices[i] - kShift - start.vertices[i]).norm(), 1e-8) << i;
  }
  ASSERT_TRUE(imported.source.has_value());
  EXPECT_EQ(imported.source->crs, "EPSG:32632");
  EXPECT_EQ(imported.source->offset, kShift);
  EXPECT_THAT(imported.source->tiles, testing::ElementsAre("Tile_+000_+000"));
  ASSERT_EQ(imported.source->tile_rects.size(), 1u);
  const auto least_x = std::min_element(start.vertices.begin(), start.vertices.end(),
                                        [](const auto& a, const auto& b) { return a.x() < b.x(); });
  EXPECT_NEAR(imported.source->tile_rects[0].x0, least_x->x(), 1e-8);
  const auto report = nlohmann::json::parse(Content(scene_ + "/import.json"));
  EXPECT_EQ(report["format"], "blocksexchange");
  EXPECT_EQ(report["proof"]["proven"], true);
  EXPECT_EQ(report["files"][0]["sha256"].get<std::string>().size(), 64u);
  EXPECT_FALSE(report["conventions"].empty());
  EXPECT_TRUE(fs::is_symlink(fs::path(scene_) / "images" / made.views[0].name));
  EXPECT_EQ(Tessera(folder_.path(), {"check", scene_}).exit_code, 0);
  EXPECT_EQ(Import({"--images", ToyCity() + "/images"}).exit_code, 2) << "the scene exists";
}

// Two commands from a block of another machine to a result. Its local frame, and with it all rounding, is that of the
// scene itself, because the shift is a multiple of 1,024 m.
TEST_F(ImportTest, ResultOfAnImportedSceneIsThatOfTheScene) {
  const Eigen::Vector3d shift(691200, 5334016, 0);
  WriteBlock(Block(shift));
  WriteMesh(shift);
  const Outcome import = Import({"--images", ToyCity() + "/images", "--mesh", mesh_, "--frame", "grid", "--labels",
                                 "material", "--classes", WriteClasses()});
  ASSERT_EQ(import.exit_code, 0) << import.output;
  fs::copy(ToyCity() + "/likelihoods", scene_ + "/likelihoods");
  // On one level: where the last digits of poses differ, the second split of faces may decide otherwise.
  const auto result = [&](const std::string& scene, const std::string& out) {
    const Outcome run = Tessera(folder_.path(), {"run", scene, "--tiles", "4", "--levels", "0", "--iterations", "8",
                                                 "--out", folder_.path() + out});
    EXPECT_EQ(run.exit_code, 0) << run.output;
    return ReadPly(folder_.path() + out + "/mesh.ply").value().mesh;
  };
  const TriangleMesh imported = result(scene_, "/imported"), made = result(ToyCity(), "/made");
  EXPECT_EQ(imported.faces, made.faces);
  EXPECT_EQ(imported.labels, made.labels);
  ASSERT_EQ(imported.vertices.size(), made.vertices.size());
  for (size_t v = 0; v < made.vertices.size(); ++v) {
    ASSERT_LT((imported.vertices[v] - shift - made.vertices[v]).norm(), 1e-6) << v;
  }
}

TEST_F(ImportTest, HeightsAreKeptForTheWayBack) {
  WriteBlock(Block());
  WriteMesh(kShift);
  const Outcome outcome = Import({"--images", ToyCity() + "/images", "--mesh", mesh_, "--crs", "EPSG:32632+5773",
                                  "--mesh-crs", "EPSG:32632+5773", "--geoid-height", "47.5"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  Warnings warnings;
  const SceneDescription scene = LoadScene(scene_, &warnings).value();
  ASSERT_TRUE(scene.source.has_value());
  EXPECT_EQ(scene.source->crs, "EPSG:32632+5773");
  EXPECT_EQ(scene.source->heights.geoid_height_m, 47.5);
}

TEST_F(ImportTest, ImagesMayBeCopied) {
  WriteBlock(Block());
  WriteMesh(kShift);
  const Outcome outcome = Import(
      {"--image-path", "d:\\flights\\may=" + ToyCity() + "/images", "--mesh", mesh_, "--frame", "grid", "--copy"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  for (const auto& entry : fs::directory_iterator(scene_ + "/images")) EXPECT_FALSE(entry.is_symlink()) << entry.path();
}

TEST_F(ImportTest, MissingImagesAreListedWithTheOptionThatFindsThem) {
  WriteBlock(Block());
  fs::create_directories(folder_.path() + "/photos/may");
  for (const auto& entry : fs::directory_iterator(ToyCity() + "/images")) {
    fs::create_symlink(entry.path(), folder_.path() + "/photos/may/" + entry.path().filename().string());
  }
  fs::create_directories(folder_.path() + "/project");
  fs::rename(block_, folder_.path() + "/project/block.xml");
  const Outcome outcome = Tessera(folder_.path(), {"import", folder_.path() + "/project/block.xml", "--out", scene_});
  EXPECT_EQ(outcome.exit_code, 3);
  EXPECT_THAT(outcome.output,
              AllOf(HasSubstr("D:\\flights\\may\\"),
                    HasSubstr(absl::StrCat("--image-path 'D:/flights'='", folder_.path(), "/photos'"))));
  EXPECT_FALSE(fs::exists(scene_));
}

TEST_F(ImportTest, WrongRotationsAreRefusedWithTheReadingThatFits) {
  ImportedBlock block = Block();
  for (BlockImage& image : block.images) image.rotation_cam_from_block.transposeInPlace();
  WriteBlock(block);
  const Outcome outcome = Import({"--images", ToyCity() + "/images", "--frame", "grid"});
  EXPECT_EQ(outcome.exit_code, 3);
  EXPECT_THAT(outcome.output, HasSubstr("transposed rotations"));
  EXPECT_FALSE(fs::exists(scene_));
}

TEST_F(ImportTest, MeshWithAnotherOffsetIsRefused) {
  WriteBlock(Block());
  WriteMesh(kShift + Eigen::Vector3d(3000, 0, 0));
  const Outcome outcome = Import({"--images", ToyCity() + "/images", "--mesh", mesh_, "--frame", "grid"});
  EXPECT_EQ(outcome.exit_code, 3);
  EXPECT_THAT(outcome.output, AllOf(HasSubstr("mesh.ply"), Not(HasSubstr(".tessera-import-"))));
  EXPECT_FALSE(fs::exists(scene_));
  for (const auto& entry : fs::directory_iterator(folder_.path())) {
    EXPECT_THAT(entry.path().filename().string(), Not(HasSubstr(".tessera-import-")));
  }
}

// A block whose coordinates are Cartesian, and that says UTM.
TEST_F(ImportTest, FrameIsTheOneThatTheTiePointsFit) {
  ImportedBlock block = Block();
  ObserveAgain(&block);  // without noise, which would hide the difference in so small images
  WriteBlock(block);
  const Outcome outcome = Import({"--images", ToyCity() + "/images"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(outcome.output, AllOf(HasSubstr("in the other frame"), HasSubstr("the scene has no mesh")));
  EXPECT_EQ(nlohmann::json::parse(Content(scene_ + "/scene.json"))["crs"]["type"], "utm");
  fs::remove_all(scene_);
  const Outcome chosen = Import({"--images", ToyCity() + "/images", "--frame", "true"});
  ASSERT_EQ(chosen.exit_code, 0) << chosen.output;
  EXPECT_THAT(chosen.output, HasSubstr("the tie points fit --frame grid better"));
  EXPECT_EQ(nlohmann::json::parse(Content(scene_ + "/scene.json"))["crs"]["type"], "enu");
}

}  // namespace
}  // namespace tessera::e2e
