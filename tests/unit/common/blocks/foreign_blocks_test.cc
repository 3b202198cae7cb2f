#include "common/blocks/foreign_blocks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "common/blocks/block_format.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

using ::testing::HasSubstr;

struct ForeignCase {
  std::string name, content, found, remedy;
};

TEST(ForeignBlocks, NamesProgramAndWhatToExport) {
  const std::string xml = "<?xml version=\"1.0\"?>\n";
  const ForeignCase cases[] = {
      {"bundle.out", "# Bundle file v0.3\n3 100\n", "Bundler", "COLMAP"},
      {"cameras.sfm", "{\n  \"version\": [\"1\"],\n \"featuresFolders\": [], \"views\": []}", "Meshroom",
       "ExportColmap"},
      {"sfm.json", "{\"version\": [], \"views\": [{\"viewId\": \"1\"}]}", "Meshroom", "ExportColmap"},
      {"scene.baf", "1\n11\n11863\n", "Meshroom", "ExportColmap"},
      {"Orientation-a.jpg.xml", xml + "<ExportAPERO>\n<OrientationConique>", "MicMac", "Apero2NVM"},
      {"Tile_+000_+000.osgb", std::string("\xa1\x0e\x91\x6c\x45\x45\xfb\x1a rest"), "OSGB", "OBJ format"},
      {"Scene.3mx", "{ \"3mxVersion\": 1 }", "3MX", "OBJ format"},
      {"node.3mxb", "3MXBO....", "3MX", "OBJ format"},
      {"0.b3dm", "b3dm\1", "3D Tiles", "--mesh"},
      {"tileset.json", "{\"asset\": {}, \"geometricError\": 1, \"root\": {}}", "3D Tiles", "--mesh"},
      {"city.dae", xml + "<COLLADA xmlns=\"x\">", "COLLADA", "--mesh"},
      {"city.fbx", "Kaydara FBX Binary  ", "FBX", "--mesh"},
      {"text.fbx", "; FBX 7.4.0 project file", "FBX", "--mesh"},
      {"mesh.drc", "DRACO\2\2", "Draco", "--mesh"},
      {"cloud.las", "LASF....", "point cloud", "a mesh, not points"},
      {"mesh.glb", "glTF\2", "GLB", "--mesh"},
      {"mesh.ply", "ply\nformat ascii 1.0\n", "PLY", "--mesh"},
      {"block.rcproj", xml + "<Project/>", "RealityScan", "XMP or as CSV"},
      {"site.p4d", xml + "<x/>", "Pix4D", "calibrated_camera_parameters.txt"},
      {"sfm_data.json", "{\"sfm_data_version\": \"0.3\"}", "OpenMVG", "openMVG2"},
      {"block.xml", "version https://git-lfs.github.com/spec/v1\n", "Git LFS pointer", "git lfs pull"},
      {"block.zip", std::string("PK\3\4..."), "ZIP", "unpack"},
  };
  StatusOr<TempFolder> folder = TempFolder::Create("");
  ASSERT_TRUE(folder.ok());
  for (const ForeignCase& c : cases) {
    const std::optional<ForeignBlock> found = RecogniseForeignBlock(c.name, c.content);
    ASSERT_TRUE(found.has_value()) << c.name;
    EXPECT_THAT(found->name, HasSubstr(c.found));
    EXPECT_THAT(found->remedy, HasSubstr(c.remedy));
    const std::string path = folder->path() + "/" + c.name;
    ASSERT_TRUE(WriteFileAtomic(path, c.content).ok());
    Warnings warnings;
    const absl::Status status = ReadBlock(path, std::nullopt, {}, &warnings).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(status.message(), HasSubstr(c.remedy)) << c.name;
  }
}

TEST(ForeignBlocks, DoesNotKnowOtherContent) {
  EXPECT_FALSE(RecogniseForeignBlock("a.txt", "some text").has_value());
  EXPECT_FALSE(RecogniseForeignBlock("a.json", "{\"views\": 3}").has_value());
  EXPECT_FALSE(RecogniseForeignBlock("a.json", "").has_value());
  EXPECT_FALSE(RecogniseForeignBlock("a.xml", "<?xml version=\"1.0\"?><Other/>").has_value());
  Warnings warnings;
  EXPECT_THAT(ReadBlock("/does/not/exist", std::nullopt, {}, &warnings).status().message(),
              HasSubstr("no block of a known format, expected one of "));
  EXPECT_THAT(ReadBlock("/", "nonsense", {}, &warnings).status().message(), HasSubstr("--format: found 'nonsense'"));
}

TEST(ForeignBlocks, LooksIntoFolders) {
  StatusOr<TempFolder> folder = TempFolder::Create("");
  ASSERT_TRUE(folder.ok());
  std::filesystem::create_directories(folder->path() + "/Data/Tile_+000_+000/deep/deeper");
  const std::string osgb("\xa1\x0e\x91\x6c\x45\x45\xfb\x1a");
  ASSERT_TRUE(WriteFileAtomic(folder->path() + "/Data/Tile_+000_+000/deep/deeper/x.osgb", osgb).ok());
  EXPECT_FALSE(FindForeignBlock(folder->path()).has_value()) << "below three levels";
  ASSERT_TRUE(WriteFileAtomic(folder->path() + "/Data/Tile_+000_+000/x.osgb", osgb).ok());
  const std::optional<ForeignBlock> found = FindForeignBlock(folder->path());
  ASSERT_TRUE(found.has_value());
  EXPECT_THAT(found->name, HasSubstr("an OSGB file, Data/Tile_+000_+000/x.osgb"));
}

}  // namespace
}  // namespace tessera
