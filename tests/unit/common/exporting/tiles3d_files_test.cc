#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>

#include "common/base/parallel.h"
#include "common/exporting/tiles3d/tiles3d_glb.h"
#include "common/meshio/gltf.h"
#include "tests/unit/common/exporting/tiles3d_reader.h"

namespace tessera {
namespace {

// A roof of two triangles with a ridge; each triangle has its own class.
struct TwoClassRoof {
  Tiles3dVertices vertices;
  Tiles3dFaces faces;
  std::vector<SceneClass> classes;

  TwoClassRoof() {
    vertices.positions = {{100, 200, 10}, {101, 200, 10}, {100, 201, 10.5}, {101, 201, 11}};
    vertices.normals.assign(4, Eigen::Vector3f::UnitZ());
    vertices.confidence = {0, 0.25f, 0.5f, 1};
    faces.Add({0, 1, 2}, 1);
    faces.Add({2, 1, 3}, -1);
    for (const char* name : {"ground", "</script>\"\\\n\xff roof"}) {
      SceneClass& c = classes.emplace_back();
      c.name = name;
      c.color_rgb = {255, 0, 188};
    }
  }
};

TEST(Tiles3dGlbTest, DoublesVerticesBetweenClassesAndHasTheirTable) {
  const TwoClassRoof roof;
  const ReadTileGlb glb = ParseTiles3dGlb(MakeTiles3dGlb(roof.vertices, roof.faces, roof.classes, false));
  ASSERT_EQ(glb.mesh.vertices.size(), 6u);
  ASSERT_EQ(glb.mesh.faces.size(), 2u);
  EXPECT_EQ(glb.mesh.labels, (std::vector<int32_t>{1, 2}));
  for (int f = 0; f < 2; ++f) {
    for (int k = 0; k < 3; ++k) {
      const uint32_t source = roof.faces.corners[f][k], v = glb.mesh.faces[f][k];
      EXPECT_EQ(glb.mesh.vertices[v], roof.vertices.positions[source]);
      EXPECT_EQ(glb.confidence[v], roof.vertices.confidence[source]);
      EXPECT_NEAR(glb.normals[v].norm(), 1, 1e-5);
      EXPECT_GT(glb.normals[v].y(), 0.5);  // y is up
    }
  }
  EXPECT_TRUE(glb.displacement.empty());
  // Linear: 188 of 255 is half the light.
  EXPECT_EQ(glb.colors[0][0], 65535);
  EXPECT_EQ(glb.colors[0][1], 0);
  EXPECT_NEAR(glb.colors[0][2], 0.5 * 65535, 300);

  const auto& table = glb.json["extensions"]["EXT_structural_metadata"]["propertyTables"][0];
  EXPECT_EQ(table["count"], 3);
  const std::string names = glb.View(table["properties"]["name"]["values"]);
  EXPECT_EQ(names, "ground</script>\"\\\n\\xff roofunlabelled");
  const std::string ends = glb.View(table["properties"]["name"]["stringOffsets"]);
  ASSERT_EQ(ends.size(), 16u);
  uint32_t last = 0;
  std::memcpy(&last, ends.data() + 12, 4);
  EXPECT_EQ(last, names.size());
  EXPECT_EQ(glb.View(table["properties"]["asprs"]["values"]), std::string("\x02\x06\x00", 3));
  const auto& feature = glb.json["meshes"][0]["primitives"][0]["extensions"]["EXT_mesh_features"]["featureIds"][0];
  EXPECT_EQ(feature["propertyTable"], 0);
  EXPECT_EQ(feature["featureCount"], 3);
}

TEST(Tiles3dGlbTest, StatesTheRangeOfPositionsAndAlignsItsViews) {
  const TwoClassRoof roof;
  const ReadTileGlb glb = ParseTiles3dGlb(MakeTiles3dGlb(roof.vertices, roof.faces, roof.classes, false));
  const auto& position =
      glb.json["accessors"][glb.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"].get<int>()];
  Eigen::AlignedBox3f box;
  for (size_t v = 0; v < 6; ++v) {
    box.extend(Eigen::Vector3f(glb.Value<float>(0, v, 0), glb.Value<float>(0, v, 1), glb.Value<float>(0, v, 2)));
  }
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(position["min"][k].get<float>(), box.min()[k]);
    EXPECT_EQ(position["max"][k].get<float>(), box.max()[k]);
  }
  for (const auto& view : glb.json["bufferViews"]) EXPECT_EQ(view["byteOffset"].get<size_t>() % 8, 0u);
}

TEST(Tiles3dGlbTest, IsUnlitWithTheColoursOfPhotographs) {
  TwoClassRoof roof;
  roof.vertices.colors.assign(4, Rgb{0, 0, 0});
  roof.vertices.colors[3] = {255, 255, 255};
  const ReadTileGlb glb = ParseTiles3dGlb(MakeTiles3dGlb(roof.vertices, roof.faces, roof.classes, true));
  EXPECT_TRUE(glb.json["materials"][0]["extensions"].contains("KHR_materials_unlit"));
  EXPECT_TRUE(glb.normals.empty());
  EXPECT_EQ(glb.colors[glb.mesh.faces[1][2]], (std::array<uint16_t, 4>{65535, 65535, 65535, 65535}));
  EXPECT_EQ(glb.colors[glb.mesh.faces[1][1]], (std::array<uint16_t, 4>{0, 0, 0, 65535}));
}

TEST(Tiles3dGlbTest, IsReadByTheProjectsReader) {
  const TwoClassRoof roof;
  MeshReadOptions options;
  options.label_property = "_FEATURE_ID_0";
  const StatusOr<MeshContent> read =
      ParseGltf(MakeTiles3dGlb(roof.vertices, roof.faces, roof.classes, false), "a.glb", options);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->mesh.vertices.size(), 4u);
  EXPECT_EQ(read->mesh.labels, (std::vector<int32_t>{1, 2}));
}

TEST(Tiles3dGlbTest, HasExactPositionsAlsoIfItIsWide) {
  Tiles3dVertices vertices;
  Tiles3dFaces faces;
  Random random(3);
  for (uint32_t f = 0; f < 300; ++f) {
    const Eigen::Vector3d corner(random.Uniform(-40000, 40000), random.Uniform(-40000, 40000),
                                 random.Uniform(-100, 500));
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d p = corner + Eigen::Vector3d(k == 1 ? 3.3 : 0, k == 2 ? 1.7 : 0, random.Uniform());
      vertices.positions.push_back((p / kTiles3dGrid_m).array().round() * kTiles3dGrid_m);
      vertices.normals.push_back(Eigen::Vector3f::UnitZ());
    }
    faces.Add({3 * f, 3 * f + 1, 3 * f + 2}, 0);
  }
  const ReadTileGlb glb = ParseTiles3dGlb(MakeTiles3dGlb(vertices, faces, {}, false));
  EXPECT_GT(glb.json["nodes"].size(), 10u);
  ASSERT_EQ(glb.mesh.vertices.size(), vertices.positions.size());
  std::set<std::array<double, 3>> found;
  for (const Eigen::Vector3d& p : glb.mesh.vertices) found.insert({p.x(), p.y(), p.z()});
  for (const Eigen::Vector3d& p : vertices.positions) EXPECT_TRUE(found.contains({p.x(), p.y(), p.z()}));
}

TEST(Tiles3dGlbTest, KnowsTheClassesOfAsprs) {
  EXPECT_EQ(AsprsClassOf("Ground"), 2);
  EXPECT_EQ(AsprsClassOf("low vegetation"), 5);
  EXPECT_EQ(AsprsClassOf("facade"), 6);
  EXPECT_EQ(AsprsClassOf("WATER"), 9);
  EXPECT_EQ(AsprsClassOf("<b>"), 1);
}

// Earth-centred coordinates on WGS 84 by the textbook's formula.
Eigen::Vector3d TileEarthCentred(double lat_rad, double lon_rad, double height_m) {
  const double a = 6378137, f = 1 / 298.257223563, e2 = f * (2 - f);
  const double n = a / std::sqrt(1 - e2 * std::sin(lat_rad) * std::sin(lat_rad));
  return {(n + height_m) * std::cos(lat_rad) * std::cos(lon_rad),
          (n + height_m) * std::cos(lat_rad) * std::sin(lon_rad), (n * (1 - e2) + height_m) * std::sin(lat_rad)};
}

// The distance of `expected` to the nearest vertex of the finest tiles, placed by the root's transform.
double TileDistanceOnGlobe(const ExportedTerrain& terrain, const Eigen::Vector3d& expected) {
  const auto json = ReadTileJson(terrain.path("result/tileset.json"))["root"]["transform"];
  Eigen::Matrix4d matrix;
  for (int k = 0; k < 16; ++k) matrix(k % 4, k / 4) = json[k];
  double nearest_m = 1e9;
  for (const std::string& file : terrain.files) {
    if (!file.ends_with(".glb")) continue;
    for (const Eigen::Vector3d& p : ParseTiles3dGlb(*ReadFile(terrain.path(file))).mesh.vertices) {
      nearest_m = std::min(nearest_m, ((matrix * p.homogeneous()).head<3>() - expected).norm());
    }
  }
  return nearest_m;
}

std::vector<Eigen::Vector3d> TileCornersOf(const ExportedTerrain& terrain) {
  return {terrain.sheets.begin()->second.vertices.front(), terrain.sheets.rbegin()->second.vertices.back()};
}

TEST(Tiles3dPlaceTest, IsWithinACentimetreForAnEastNorthUpScene) {
  Crs crs;
  crs.kind = Crs::Kind::kEnu;
  crs.lat_rad = -0.6;
  crs.lon_rad = 2.5;
  crs.height_m = 73;
  ExportedTerrain terrain(50, 1, crs, {2000, -3000, 10});
  terrain.Write();
  const double lat = crs.lat_rad, lon = crs.lon_rad;
  const Eigen::Vector3d east(-std::sin(lon), std::cos(lon), 0);
  const Eigen::Vector3d up(std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat));
  for (const Eigen::Vector3d& local : TileCornersOf(terrain)) {
    const Eigen::Vector3d p = terrain.scene.frame.SceneFromLocal(local);
    const Eigen::Vector3d expected =
        TileEarthCentred(lat, lon, crs.height_m) + p.x() * east + p.y() * up.cross(east) + p.z() * up;
    EXPECT_LT(TileDistanceOnGlobe(terrain, expected), 0.01);
  }
}

TEST(Tiles3dPlaceTest, IsWithinACentimetreForAUtmScene) {
  Crs crs;
  crs.kind = Crs::Kind::kUtm;
  crs.zone = 33;
  ExportedTerrain terrain(50, 1, crs, {391234, 5820123, 40});
  terrain.Write();
  for (const Eigen::Vector3d& local : TileCornersOf(terrain)) {
    const StatusOr<Eigen::Vector3d> p = terrain.scene.frame.GeodeticFromLocal(local);
    ASSERT_TRUE(p.ok());
    EXPECT_NEAR(p->x(), 52.5 * 3.14159265 / 180, 0.01);
    EXPECT_LT(TileDistanceOnGlobe(terrain, TileEarthCentred(p->x(), p->y(), p->z())), 0.01);
  }
}

TEST(Tiles3dPlaceTest, IsMissingWithoutAReferenceSystemWhichTheFileSays) {
  ExportedTerrain terrain(50, 1);
  terrain.Write();
  const auto json = ReadTileJson(terrain.path("result/tileset.json"));
  EXPECT_FALSE(json["root"].contains("transform"));
  EXPECT_EQ(json["asset"]["extras"]["on_globe"], false);
  EXPECT_THAT(json["asset"]["extras"]["note"].get<std::string>(), testing::HasSubstr("no coordinate reference system"));
}

TEST(Tiles3dFilesTest, HaveTheSameBytesWithAnyNumberOfThreads) {
  const auto content = [](int threads) {
    const ThreadLimit limit(threads);
    ExportedTerrain terrain(60, 2);
    terrain.Write(true);
    std::map<std::string, std::string> files;
    for (const std::string& file : terrain.files) files[file] = *ReadFile(terrain.path(file));
    return files;
  };
  const auto first = content(1);
  EXPECT_GT(first.size(), 20u);
  EXPECT_EQ(first, content(4));
}

TEST(Tiles3dFilesTest, AreThoseThatAreReturned) {
  ExportedTerrain terrain(60, 2);
  terrain.Write(true);
  std::vector<std::string> expected = terrain.files;
  for (const auto& [id, sheet] : terrain.sheets) expected.push_back("part" + SheetName(id));
  EXPECT_THAT(*ListFiles(terrain.folder.path()), testing::UnorderedElementsAreArray(expected));
  EXPECT_THAT(expected, testing::Contains("start/tileset.json"));
  EXPECT_THAT(expected, testing::Contains(testing::StartsWith("result/upper/")));
}

TEST(Tiles3dFilesTest, HaveOneRootForTheFourSheetsAroundTheOrigin) {
  ExportedTerrain terrain(40, 2);
  ASSERT_EQ(terrain.sheets.size(), 4u);
  terrain.Write();
  EXPECT_EQ(ReadTiles3d(terrain.path("result")).children.size(), 4u);
}

TEST(Tiles3dFilesTest, HaveTheColoursThatAreAskedFor) {
  ExportedTerrain terrain(30, 2);
  terrain.options.color = VertexColor::kDisplacement;
  terrain.scene.gsd_m = 0.05;  // 0.25 m are half of the scale
  terrain.Write();
  const ReadTileGlb glb = ParseTiles3dGlb(*ReadFile(terrain.path("result/0_0/0.glb")));
  EXPECT_THAT(glb.displacement, testing::Each(0.25f));
  // The middle of YlOrRd, (253, 141, 60), in linear light.
  for (const auto& color : glb.colors) {
    EXPECT_NEAR(color[0] / 65535.0, 0.98225, 1e-4);
    EXPECT_NEAR(color[1] / 65535.0, 0.26636, 1e-4);
    EXPECT_NEAR(color[2] / 65535.0, 0.04519, 1e-4);
  }
  EXPECT_EQ(ReadTiles3d(terrain.path("result")).children.size(), 4u);
}

TEST(Tiles3dFilesTest, FlagASheetWithQuarantinedTiles) {
  ExportedTerrain terrain(40, 2);
  terrain.Write(false, {-1, 0});
  EXPECT_EQ(ReadTileJson(terrain.path("result/-1_0/tileset.json"))["extras"]["quarantined"], true);
  EXPECT_FALSE(ReadTileJson(terrain.path("result/0_0/tileset.json")).contains("extras"));
  int flagged = 0;
  const nlohmann::json tileset = ReadTileJson(terrain.path("result/tileset.json"));
  for (const auto& child : tileset["root"]["children"]) {
    if (!child.contains("extras")) continue;
    EXPECT_EQ(child["content"]["uri"], "-1_0/tileset.json");
    ++flagged;
  }
  EXPECT_EQ(flagged, 1);
}

TEST(Tiles3dFilesTest, OfASheetWithoutFacesAreNone) {
  ExportedTerrain terrain(30, 2);
  terrain.sheets[{7, 7}] = Sheet();
  terrain.Write();
  EXPECT_THAT(terrain.files, testing::Not(testing::Contains(testing::HasSubstr("7_7"))));
}

TEST(Tiles3dFilesTest, AreNotWrittenAfterACancellation) {
  ExportedTerrain terrain(40, 2);
  TaskControl control;
  control.cancelled = [] { return true; };
  const auto& [id, sheet] = *terrain.sheets.begin();
  const SheetInput input{terrain.scene, terrain.options, id, sheet, {}, {}, {}, {}, {}, false};
  EXPECT_EQ(WriteTiles3dSheet(input, terrain.folder.path(), control, terrain.sizes).status().code(),
            absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace tessera
