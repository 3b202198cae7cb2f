#include "common/importing/mesh_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "common/storage/files.h"
#include "tests/support/meshes/tile_folder.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

namespace fs = std::filesystem;

// A new folder with these files, whose content is their name.
std::string FolderWith(const std::vector<std::string>& files) {
  const fs::path folder = fs::path(testing::TempDir()) / "mesh_source";
  fs::remove_all(folder);
  fs::create_directories(folder);
  for (const std::string& file : files) {
    fs::create_directories((folder / file).parent_path());
    std::ofstream(folder / file) << file;
  }
  return folder.string();
}

std::string SourceError(const std::string& path) {
  const StatusOr<MeshSource> source = FindMeshSource(path);
  EXPECT_EQ(source.status().code(), absl::StatusCode::kInvalidArgument) << source.status();
  return std::string(source.status().message());
}

TEST(MeshSource, FindsTilesAndTheirSystemFromEachFolder) {
  const std::string folder = AbsolutePath(testing::TempDir() + "/source_tiles");
  TileFolder().Write(folder);
  for (const char* const below : {"", "/", "/Data"}) {
    const StatusOr<MeshSource> source = FindMeshSource(folder + below);
    ASSERT_TRUE(source.ok()) << source.status();
    EXPECT_THAT(source->tile_names,
                ElementsAre("Tile_+000_+000", "Tile_+000_+001", "Tile_+001_+000", "Tile_+001_+001"));
    EXPECT_EQ(source->files[1], folder + "/Data/Tile_+000_+001/Tile_+000_+001.obj");
    EXPECT_EQ(source->crs, "EPSG:32632");
    EXPECT_EQ(source->offset, Eigen::Vector3d(691000.5, 5334000.25, 500));
    EXPECT_THAT(source->metadata, ElementsAre(folder + "/metadata.xml"));
    EXPECT_THAT(source->conventions, ElementsAre(HasSubstr("(691000.5, 5334000.25, 500) is added")));
    EXPECT_THAT(source->left_out, IsEmpty());
  }
  const StatusOr<MeshSource> one = FindMeshSource(folder + "/Data/Tile_+001_+000/Tile_+001_+000.obj");
  ASSERT_TRUE(one.ok()) << one.status();
  EXPECT_THAT(one->tile_names, ElementsAre("Tile_+001_+000"));
  EXPECT_EQ(one->crs, "EPSG:32632");
}

TEST(MeshSource, TakesTheFinestLevelOfATile) {
  const std::string folder =
      FolderWith({"Tile_+000_+000/Tile_+000_+000.obj", "Tile_+000_+000/Tile_+000_+000_L20_0.obj",
                  "Tile_+000_+000/Tile_+000_+000_L21_0.obj", "Tile_+000_+000/Tile_+000_+000_L21_3.obj",
                  "Tile_+001_+000/Tile_+001_+000.obj", "Tile_+001_+001/Tile_+001_+001_L19_2.obj"});
  const StatusOr<MeshSource> source = FindMeshSource(folder);
  ASSERT_TRUE(source.ok()) << source.status();
  EXPECT_THAT(source->tile_names,
              ElementsAre("Tile_+000_+000_L21_0", "Tile_+000_+000_L21_3", "Tile_+001_+000", "Tile_+001_+001_L19_2"));
  EXPECT_THAT(source->left_out, ElementsAre("2 mesh files of coarser levels of detail (4 files of the finest levels "
                                            "are read)"));
}

TEST(MeshSource, BranchesOfATreeMayEndAtDifferentLevels) {
  const std::string folder =
      FolderWith({"T_L20_0.obj", "T_L20_1.obj", "T_L21_00.obj", "T_L21_03.obj", "T_L22_031.obj"});
  const StatusOr<MeshSource> source = FindMeshSource(folder);
  ASSERT_TRUE(source.ok()) << source.status();
  EXPECT_THAT(source->tile_names, ElementsAre("T_L20_1", "T_L21_00", "T_L22_031"));
}

TEST(MeshSource, NamesThatRepeatHaveTheirFolders) {
  const StatusOr<MeshSource> source = FindMeshSource(FolderWith({"north/mesh.ply", "south/mesh.ply", "south/b.GLB"}));
  ASSERT_TRUE(source.ok()) << source.status();
  EXPECT_THAT(source->tile_names, ElementsAre("b", "north/mesh", "south/mesh"));
  EXPECT_EQ(source->crs, "");
  EXPECT_EQ(source->offset, Eigen::Vector3d(0, 0, 0));
  EXPECT_THAT(source->conventions, ElementsAre(HasSubstr("(x, y, z) becomes (x, -z, y)")));
}

TEST(MeshSource, LeavesOutMetadataOfOtherPrograms) {
  const std::string folder = FolderWith({"mesh.ply", "metadata.xml"});
  const StatusOr<MeshSource> source = FindMeshSource(folder);
  ASSERT_TRUE(source.ok()) << source.status();
  EXPECT_THAT(source->left_out, ElementsAre(HasSubstr("metadata.xml: not the metadata.xml of a ContextCapture mesh")));
  EXPECT_THAT(source->metadata, IsEmpty());
}

TEST(MeshSource, RefusesTwoFilesOfATileAndFoldersWithoutMesh) {
  EXPECT_THAT(SourceError(FolderWith({"a.obj", "a.ply", "b.glb", "b.obj"})),
              AllOf(HasSubstr("a.ply: found a second file of the tile, beside 'a.obj'"), HasSubstr("b.obj: found")));
  EXPECT_THAT(SourceError(FolderWith({"readme.txt"})), HasSubstr("found no mesh, expected a folder with OBJ"));
  EXPECT_EQ(FindMeshSource("/nowhere/mesh.obj").status().code(), absl::StatusCode::kNotFound);
}

TEST(MeshSource, ReadsTheOffsetOfOpenDroneMap) {
  const std::string folder =
      FolderWith({"odm_texturing/odm_textured_model_geo.obj", "odm_texturing/odm_textured_model.obj",
                  "odm_georeferencing/odm_georeferencing_model_geo.txt"});
  const std::string offset = folder + "/odm_georeferencing/odm_georeferencing_model_geo.txt";
  std::ofstream(offset) << "WGS84 UTM 15N\n576705.1057826 5188170.6047917\n";
  for (const char* const below : {"", "/odm_texturing", "/odm_texturing/odm_textured_model_geo.obj"}) {
    const StatusOr<MeshSource> source = FindMeshSource(folder + below);
    ASSERT_TRUE(source.ok()) << source.status();
    EXPECT_THAT(source->tile_names, ElementsAre("odm_textured_model_geo"));
    EXPECT_EQ(source->left_out.size(), fs::is_directory(folder + below) ? 1u : 0u);
    EXPECT_EQ(source->crs, "EPSG:32615");
    EXPECT_EQ(source->offset, Eigen::Vector3d(576705.1057826, 5188170.6047917, 0));
  }
  std::ofstream(offset) << "WGS84 UTM 33S\r\n5 6\r\n";
  EXPECT_EQ(FindMeshSource(folder)->crs, "EPSG:32733");
  std::ofstream(offset) << "WGS84 UTM 61N\n5 6\n";
  EXPECT_THAT(SourceError(folder), HasSubstr("line 1: found 'WGS84 UTM 61N', expected a system"));
  std::ofstream(offset) << "WGS84 UTM 15N\n5\n";
  EXPECT_THAT(SourceError(folder), HasSubstr("line 2: found '5', expected easting and northing"));
  fs::remove(offset);
  EXPECT_THAT(SourceError(folder), HasSubstr("found no odm_georeferencing_model_geo.txt"));
}

TEST(MeshSource, ParsesMetadata) {
  const StatusOr<ModelMetadata> metadata = ParseModelMetadata(
      "\xef\xbb\xbf<?xml version=\"1.0\" encoding=\"utf-8\"?><ModelMetadata version=\"1\">\n <SRS> "
      "ENU:39.97523,-83.00678 "
      "</SRS><SRSOrigin> 1.5, -2e3 ,0</SRSOrigin><Texture><ColorSource>Visible</ColorSource></Texture></ModelMetadata>",
      "metadata.xml");
  ASSERT_TRUE(metadata.ok()) << metadata.status();
  EXPECT_EQ(metadata->crs, "ENU:39.97523,-83.00678");
  EXPECT_EQ(metadata->origin, Eigen::Vector3d(1.5, -2000, 0));
  EXPECT_TRUE(ParseModelMetadata("<ModelMetadata/>", "m")->crs.empty());
  const auto error = [](const std::string& bytes) {
    return std::string(ParseModelMetadata(bytes, "m").status().message());
  };
  EXPECT_THAT(error("<ModelMetadata><SRSOrigin>1,2</SRSOrigin></ModelMetadata>"),
              HasSubstr("m: /ModelMetadata/SRSOrigin: found '1,2', expected three numbers"));
  EXPECT_THAT(error("<ModelMetadata><SRSOrigin>1,2,nan</SRSOrigin></ModelMetadata>"), HasSubstr("found '1,2,nan'"));
  EXPECT_THAT(error("<ModelMetadata>"), HasSubstr("m: byte 14: found "));
  EXPECT_THAT(error("<Other/>"), HasSubstr("m: /: found 'Other', expected the element ModelMetadata"));
  EXPECT_THAT(error("<!DOCTYPE a [<!ENTITY b \"c\">]><ModelMetadata/>"), HasSubstr("found a document type"));
  std::string deep;
  for (int k = 0; k < 3000; ++k) deep += "<a>";
  EXPECT_THAT(error(deep), HasSubstr("found a file of 9000 bytes, expected the small file"));
}

}  // namespace
}  // namespace tessera
