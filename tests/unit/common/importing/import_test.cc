// Whole imports of the tiny scene, whose block is written in the formats of other programs.
#include "common/importing/import.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numbers>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "common/blocks/block_format.h"
#include "common/geodesy/reference_system.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "tests/support/blocks/write_blocks_exchange.h"
#include "tests/support/blocks/write_metashape.h"
#include "tests/support/blocks/write_openmvs.h"
#include "tests/support/blocks/write_opensfm.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr char kUtm31[] =
    "PROJCS[\"WGS 84 / UTM zone 31N\",GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],"
    "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433],AUTHORITY[\"EPSG\",\"4326\"]],PROJECTION["
    "\"Transverse_Mercator\"],PARAMETER[\"latitude_of_origin\",0],PARAMETER[\"central_meridian\",3],PARAMETER["
    "\"scale_factor\",0.9996],PARAMETER[\"false_easting\",500000],PARAMETER[\"false_northing\",0],UNIT[\"metre\",1]]";

class ImportSceneTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = AbsolutePath(FreshTestFolder("import"));
    TinySceneOptions options;
    options.tower = true;
    options.likelihoods = TinySceneOptions::Likelihoods::kNone;
    options.labels = false;
    tiny_ = WriteTinyScene(folder_, options);
    Warnings warnings;
    block_ = ReadBlock(folder_ + "/colmap", "colmap", {}, &warnings).value();
    options_.mesh = folder_ + "/mesh.ply";
    options_.photographs.folders = {folder_ + "/images"};
  }
  StatusOr<nlohmann::json> Import(const std::string& source) {
    options_.source = folder_ + "/" + source;
    warnings_.clear();
    const StatusOr<ImportResult> result = ImportScene(options_, folder_ + "/scene", &warnings_, {});
    if (!result.ok()) return result.status();
    return nlohmann::json::parse(result->json);
  }
  std::string Refusal(const std::string& source) {
    const Status status = Import(source).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << status;
    EXPECT_FALSE(std::filesystem::exists(folder_ + "/scene"));
    return std::string(status.message());
  }

  std::string folder_;
  TinyScene tiny_;
  ImportedBlock block_;  // of the scene
  ImportOptions options_;
  Warnings warnings_;
};

TEST_F(ImportSceneTest, OpenMvsIsProvenByPatches) {
  WriteText(folder_ + "/scene.mvs", WriteOpenMvs(block_));
  const StatusOr<nlohmann::json> report = Import("scene.mvs");
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ((*report)["format"], "openmvs");
  EXPECT_EQ((*report)["proof"]["tie_points"]["observations"], 0);
  EXPECT_EQ((*report)["proof"]["proven"], true) << report->dump(1);
  EXPECT_EQ((*report)["proof"]["patches"]["proven"], true);
}

TEST_F(ImportSceneTest, OpenMvsWithTurnedCamerasIsRefusedByPatches) {
  for (size_t i = 0; i < block_.images.size(); ++i) {
    const double angle = (i % 2 == 0 ? 4 : -4) / block_.cameras[0].lens.pinhole.fx;
    Eigen::Matrix3d& rotation = block_.images[i].rotation_cam_from_block;
    rotation = Eigen::AngleAxisd(angle, Eigen::Vector3d(0.8, -0.6, 0)).toRotationMatrix() * rotation;
  }
  WriteText(folder_ + "/scene.mvs", WriteOpenMvs(block_));
  EXPECT_THAT(Refusal("scene.mvs"), HasSubstr("(--max-error-px)"));
}

TEST_F(ImportSceneTest, OpenSfmWithoutTracksIsProvenByPatches) {
  OpenSfmWriting how;
  how.more = "\"reference_lla\": {\"latitude\": 48.86, \"longitude\": 2.35, \"altitude\": 0.0}, ";
  std::filesystem::create_directories(folder_ + "/opensfm");
  WriteText(folder_ + "/opensfm/reconstruction.json", absl::StrCat("[", OpenSfmReconstruction(block_, how), "]"));
  const StatusOr<nlohmann::json> report = Import("opensfm");
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ((*report)["format"], "opendronemap");
  EXPECT_EQ((*report)["proof"]["tie_points"]["observations"], 0);
  EXPECT_EQ((*report)["proof"]["patches"]["proven"], true) << report->dump(1);
}

// Metashape: poses are earth-centred, meshes are exported in the reference of the chunk.
TEST_F(ImportSceneTest, MeshInTheSystemThatTheBlockStatesForMeshes) {
  const double lat = 48.86 * std::numbers::pi / 180, lon = 2.35 * std::numbers::pi / 180;
  const ReferenceSystem enu = ReferenceSystem::Parse("ENU:48.86,2.35").value();
  const Eigen::Vector3d origin = GeocentricFromGeodetic({lat, lon, 0});
  Eigen::Matrix3d earth_from_enu;
  earth_from_enu.col(0) << -std::sin(lon), std::cos(lon), 0;
  earth_from_enu.col(2) << std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat);
  earth_from_enu.col(1) = earth_from_enu.col(2).cross(earth_from_enu.col(0));
  ImportedBlock earth = block_;
  for (BlockImage& image : earth.images) {
    image.centre = origin + earth_from_enu * image.centre;
    image.rotation_cam_from_block *= earth_from_enu.transpose();
  }
  MetashapeWriteOptions how{.has_component = true, .has_chunk = false, .reference = kUtm31};
  how.component = {Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, -3).normalized()).toRotationMatrix(), origin, 12.3};
  WriteText(folder_ + "/cameras.xml", WriteMetashapeXml(earth, how));
  TriangleMesh mesh = tiny_.mesh;
  ReferenceSystem utm = ReferenceSystem::Parse("EPSG:32631").value();
  ASSERT_TRUE(enu.ToGeodetic(mesh.vertices).ok());
  ASSERT_TRUE(utm.LocateGeodetic(mesh.vertices[0]).ok());
  ASSERT_TRUE(utm.FromGeodetic(mesh.vertices).ok());
  ASSERT_TRUE(WritePly(folder_ + "/mesh.ply", mesh).ok());

  const StatusOr<nlohmann::json> report = Import("cameras.xml");
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ((*report)["crs"], "EPSG:4978");
  EXPECT_EQ((*report)["mesh"]["coordinates"], "the system that the block states for meshes");
  EXPECT_EQ((*report)["proof"]["patches"]["proven"], true) << report->dump(1);
  const auto scene_json = nlohmann::json::parse(ReadText(folder_ + "/scene/scene.json"));
  EXPECT_EQ(scene_json["crs"]["type"], "enu");
  EXPECT_EQ(scene_json["source"]["crs"], kUtm31);
  // Distances between cameras and vertices are those of the scene.
  Warnings warnings;
  const ImportedBlock imported = ReadBlock(folder_ + "/scene/colmap", "colmap", {}, &warnings).value();
  const TriangleMesh merged = ReadPly(folder_ + "/scene/mesh.ply").value().mesh;
  ASSERT_EQ(merged.vertices.size(), tiny_.mesh.vertices.size());
  for (const BlockImage& image : imported.images) {
    const auto written = std::find_if(block_.images.begin(), block_.images.end(),
                                      [&](const BlockImage& other) { return image.path == other.path; });
    ASSERT_NE(written, block_.images.end()) << image.path;
    for (size_t v = 0; v < merged.vertices.size(); ++v) {
      ASSERT_NEAR((merged.vertices[v] - image.centre).norm(), (tiny_.mesh.vertices[v] - written->centre).norm(), 1e-4);
    }
  }
}

TEST_F(ImportSceneTest, FaultsOfBlockImagesMeshAndOptionsAreReportedTogether) {
  for (BlockImage& image : block_.images) image.path = "D:\\flight\\" + image.path;
  const std::string text = WriteBlocksExchange(block_, {});
  WriteText(folder_ + "/block.xml", absl::StrReplaceAll(text, {{"XRightYDown", "XRightYLeft"}}));
  options_.photographs.folders = {folder_ + "/colmap"};
  options_.mesh = folder_ + "/no_mesh.obj";
  options_.labels = "classes";
  options_.crs = "EPSG:99999999";
  EXPECT_THAT(Refusal("block.xml"),
              AllOf(HasSubstr("'XRightYLeft'"), HasSubstr("--labels: found 'classes'"), HasSubstr("EPSG:99999999"),
                    HasSubstr("no file of image 'D:\\flight\\view0.png'"), HasSubstr("no_mesh.obj"),
                    HasSubstr(absl::StrCat("--image-path 'D:/flight'='", folder_, "/images' finds 9"))));
  // Without faults of the block itself, those of the proof too.
  for (BlockImage& image : block_.images) image.rotation_cam_from_block.transposeInPlace();
  WriteText(folder_ + "/block.xml", WriteBlocksExchange(block_, {}));
  options_.crs = "";
  EXPECT_THAT(Refusal("block.xml"), AllOf(HasSubstr("transposed rotations"), HasSubstr("--labels: found 'classes'"),
                                          HasSubstr("D:\\flight\\view0.png"), HasSubstr("no_mesh.obj")));
}

// The reader of NVM needs the photographs for their sizes.
TEST_F(ImportSceneTest, AllOptionsForImagesCountWhereReadersNeedSizes) {
  std::filesystem::create_directories(folder_ + "/other");
  std::filesystem::rename(folder_ + "/images/view1.png", folder_ + "/other/view1.png");
  std::filesystem::rename(folder_ + "/images/view2.png", folder_ + "/other/renamed.png");
  OpenMvsWriting how;
  how.normalised = true;
  for (BlockImage& image : block_.images) image.path = "E:\\may\\" + image.path;
  block_.images[2].path = "F:\\renamed.png";
  WriteText(folder_ + "/scene.mvs", WriteOpenMvs(block_, how));
  options_.photographs.folders = {folder_ + "/colmap", folder_ + "/images"};
  EXPECT_THAT(Refusal("scene.mvs"), AllOf(HasSubstr("'E:\\may\\view1.png'"), HasSubstr("no file for 2 of 9 images"),
                                          Not(HasSubstr("view3.png"))));
  options_.photographs.folders.push_back(folder_ + "/other");
  options_.photographs.replacements = {{"F:", folder_ + "/other"}};
  const StatusOr<nlohmann::json> report = Import("scene.mvs");
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ((*report)["images"]["used"], 9);
}

TEST_F(ImportSceneTest, PropertyThatAMeshLacksIsNamedWithTheOption) {
  WriteText(folder_ + "/scene.mvs", WriteOpenMvs(block_));
  options_.labels = "property:genus";
  EXPECT_THAT(Refusal("scene.mvs"),
              AllOf(HasSubstr("no property 'genus', which --labels names"), Not(HasSubstr("label_property"))));
}

}  // namespace
}  // namespace tessera
