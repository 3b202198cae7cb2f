#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>
#include <sstream>

#include "common/exporting/color/vertex_colors.h"
#include "common/exporting/export_map.h"
#include "common/exporting/mesh_files/clustered_mesh.h"
#include "common/exporting/mesh_files/glb_export.h"
#include "common/exporting/mesh_files/ply_export.h"
#include "common/exporting/mesh_files/welded_vertices.h"
#include "common/geodesy/reference_system.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr char kHostileName[] = "\"</script><img src=x onerror=alert(1)>\xff";

ExportScene MeshFilesScene() {
  Crs crs;
  crs.kind = Crs::Kind::kUtm;
  crs.zone = 33;
  ExportScene scene;
  scene.frame = *Frame::Around(crs, {400100, 5400200, 300});
  scene.gsd_m = 0.1;
  scene.ground = MakeGroundPlane(scene.up, 8);
  scene.classes = {{"ground", {10, 20, 30}}, {kHostileName, {200, 100, 50}}};
  return scene;
}

// Squares of `step_m` over [x0, x1] x [0, side] with a relief; faces with y < 3 have class 1.
Sheet Relief(int x0, int x1, int side, double step_m = 0.5) {
  Sheet sheet;
  const auto width = static_cast<uint32_t>(x1 - x0 + 1);
  for (int y = 0; y <= side; ++y) {
    for (int x = x0; x <= x1; ++x) {
      sheet.vertices.emplace_back(step_m * x, step_m * y, 20 + std::sin(0.3 * x) + 1.0 / 3);
    }
  }
  for (uint32_t y = 0; y < static_cast<uint32_t>(side); ++y) {
    for (uint32_t x = 0; x + 1 < width; ++x) {
      const uint32_t a = y * width + x;
      sheet.faces.push_back({a, a + 1, a + width + 1});
      sheet.faces.push_back({a, a + width + 1, a + width});
      sheet.labels.insert(sheet.labels.end(), 2, y < 3 ? 1 : x0 > 0 && y == 5 ? -1 : 0);
    }
  }
  sheet.confidence.assign(sheet.faces.size(), 0.5f);
  sheet.displacement_m.assign(sheet.vertices.size(), 0.25f);
  for (const Vector3d& p : sheet.vertices) {
    sheet.colors.push_back({static_cast<uint8_t>(5 * p.x()), static_cast<uint8_t>(5 * p.y()), 128});
  }
  return sheet;
}

// Two sheets that touch at x = 5 m, and what joins them.
struct MeshFilesCity {
  explicit MeshFilesCity(VertexColor color, std::vector<Sheet> all = {Relief(0, 10, 8), Relief(10, 22, 8)})
      : sheets(std::move(all)) {
    options.color = color;
  }

  JoinInput Input() {
    JoinInput input{.scene = scene, .options = options, .sheets = {}};
    for (int i = 0; i < static_cast<int>(sheets.size()); ++i) {
      const std::string part_folder = folder.path() + "/" + std::to_string(i);
      EXPECT_TRUE(EnsureFolder(part_folder).ok());
      EXPECT_TRUE(WriteSheet(part_folder + "/sheet", sheets[i]).ok());
      const SheetInput sheet{.scene = scene,
                             .options = options,
                             .id = {i, 0},
                             .sheet = sheets[i],
                             .neighbours = {},
                             .start = {},
                             .views = {},
                             .view_files = {},
                             .mask_files = {}};
      const StatusOr<std::vector<std::string>> files = WriteGlbPart(sheet, part_folder, {});
      EXPECT_TRUE(files.ok()) << files.status();
      EXPECT_TRUE(files->empty());
      input.sheets.push_back({{i, 0}, part_folder + "/sheet", part_folder + "/" + kPartFile, i == 1});
    }
    return input;
  }

  ExportScene scene = MeshFilesScene();
  ExportOptions options;
  std::vector<Sheet> sheets;
  TempFolder folder = *TempFolder::Create(testing::TempDir());
};

// A plain reader of binary PLY with named properties.
struct PlainPly {
  std::vector<std::map<std::string, double>> vertices, faces;  // faces: without their list
  std::vector<Triangle> corners;
  std::vector<std::string> vertex_properties, face_properties;
};

template <class T>
T TakeValue(const char** at) {
  T value;
  std::memcpy(&value, *at, sizeof(T));
  *at += sizeof(T);
  return value;
}

PlainPly ReadPlainPly(const std::string& path) {
  const std::string bytes = *ReadFile(path);
  const size_t end = bytes.find("end_header\n") + 11;
  std::istringstream header(bytes.substr(0, end));
  PlainPly ply;
  std::vector<std::pair<std::string, std::string>> types[2];
  size_t counts[2] = {};
  int element = -1;
  for (std::string word; header >> word;) {
    if (word == "element") {
      header >> word >> counts[++element];
    } else if (word == "property") {
      std::string type, name;
      header >> type;
      if (type == "list") {
        header >> type >> type >> name;
        continue;
      }
      header >> name;
      types[element].emplace_back(type, name);
      (element == 0 ? ply.vertex_properties : ply.face_properties).push_back(name);
    }
  }
  const char* at = bytes.data() + end;
  for (element = 0; element < 2; ++element) {
    for (size_t i = 0; i < counts[element]; ++i) {
      if (element == 1) {
        EXPECT_EQ(TakeValue<uint8_t>(&at), 3);
        ply.corners.push_back(TakeValue<Triangle>(&at));
      }
      std::map<std::string, double>& values = (element == 0 ? ply.vertices : ply.faces).emplace_back();
      for (const auto& [type, name] : types[element]) {
        values[name] = type == "double"  ? TakeValue<double>(&at)
                       : type == "float" ? TakeValue<float>(&at)
                       : type == "int"   ? TakeValue<int32_t>(&at)
                                         : TakeValue<uint8_t>(&at);
      }
    }
  }
  EXPECT_EQ(at, bytes.data() + bytes.size());
  return ply;
}

PlainPly JoinedPly(MeshFilesCity* city) {
  const StatusOr<std::vector<std::string>> files = JoinPly(city->Input(), city->folder.path(), {});
  EXPECT_TRUE(files.ok()) << files.status();
  EXPECT_THAT(*files, testing::ElementsAre("mesh.ply"));
  return ReadPlainPly(city->folder.path() + "/mesh.ply");
}

TEST(PlyExportTest, WritesVerticesOnceWithColoursAndLabels) {
  MeshFilesCity city(VertexColor::kImage);
  const PlainPly ply = JoinedPly(&city);
  EXPECT_THAT(ply.vertex_properties, testing::ElementsAre("x", "y", "z", "red", "green", "blue", "scalar_label"));
  EXPECT_THAT(ply.face_properties, testing::ElementsAre("label", "red", "green", "blue", "confidence"));
  EXPECT_EQ(ply.vertices.size(), 23u * 9);
  EXPECT_EQ(ply.corners.size(), 22u * 8 * 2);
  size_t f = 0;
  for (const Sheet& sheet : city.sheets) {
    for (size_t i = 0; i < sheet.faces.size(); ++i, ++f) {
      EXPECT_EQ(ply.faces[f].at("label"), sheet.labels[i]);
      EXPECT_EQ(ply.faces[f].at("confidence"), 0.5);
      for (int k = 0; k < 3; ++k) {
        const std::map<std::string, double>& vertex = ply.vertices[ply.corners[f][k]];
        const Vector3d p(vertex.at("x"), vertex.at("y"), vertex.at("z"));
        EXPECT_EQ(p, city.scene.frame.SceneFromLocal(sheet.vertices[sheet.faces[i][k]]));
        EXPECT_EQ(vertex.at("red"), sheet.colors[sheet.faces[i][k]][0]);
        EXPECT_EQ(vertex.at("green"), sheet.colors[sheet.faces[i][k]][1]);
      }
    }
  }
  const StatusOr<MeshContent> read = ReadPly(city.folder.path() + "/mesh.ply");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->mesh.faces, ply.corners);
}

TEST(PlyExportTest, LabelsVerticesOfTheBorderByTheFacesOfBothSheets) {
  // At (5, 1.5): one face of class 0 in the first sheet, two small ones of class 1 in the second.
  Sheet first, second;
  first.vertices = {{0, 0, 0}, {5, 1.5, 0}, {0, 3, 0}};
  first.faces = {{0, 1, 2}};
  first.labels = {0};
  second.vertices = {{5, 1.5, 0}, {12, 0, 0}, {12, 2, 0}, {12, 4, 0}};
  second.faces = {{0, 1, 2}, {0, 2, 3}};
  second.labels = {1, 1};
  MeshFilesCity city(VertexColor::kClass, {first, second});
  const PlainPly ply = JoinedPly(&city);
  ASSERT_EQ(ply.vertices.size(), 6u);
  EXPECT_EQ(ply.vertices[1].at("scalar_label"), 1);
  EXPECT_EQ(ply.vertices[1].at("red"), 200);
  EXPECT_EQ(ply.vertices[0].at("scalar_label"), 0);
  EXPECT_THAT(ply.face_properties, testing::Not(testing::Contains("confidence")));
}

TEST(PlyExportTest, MapsPositionsToTheSystemAskedFor) {
  MeshFilesCity city(VertexColor::kClass);
  city.options.crs = "EPSG:4326";
  const PlainPly ply = JoinedPly(&city);
  Vector3d p = city.sheets[0].vertices[0];
  ASSERT_TRUE(ExportMap::Open(city.scene, "EPSG:4326")->FromLocal({&p, 1}).ok());
  EXPECT_EQ(ply.vertices[0].at("x"), p.x());
  EXPECT_EQ(ply.vertices[0].at("y"), p.y());
  EXPECT_NEAR(p.x(), 13.6, 0.1);
}

// A plain reader of binary glTF.
struct PlainGlb {
  nlohmann::json json;
  std::string data;

  template <class T>
  std::vector<T> Values(int accessor, int components, int stride_bytes) const {
    const nlohmann::json& from = json["accessors"][accessor];
    const nlohmann::json& view = json["bufferViews"][from["bufferView"].get<size_t>()];
    const size_t offset = view.value("byteOffset", size_t{0}) + from.value("byteOffset", size_t{0});
    std::vector<T> values;
    for (size_t i = 0; i < from["count"].get<size_t>(); ++i) {
      const char* at = data.data() + offset + i * stride_bytes;
      for (int c = 0; c < components; ++c) values.push_back(TakeValue<T>(&at));
    }
    return values;
  }
};

PlainGlb ReadPlainGlb(const std::string& path) {
  const std::string bytes = *ReadFile(path);
  const char* at = bytes.data();
  EXPECT_EQ(TakeValue<uint32_t>(&at), 0x46546c67u);
  EXPECT_EQ(TakeValue<uint32_t>(&at), 2u);
  EXPECT_EQ(TakeValue<uint32_t>(&at), bytes.size());
  PlainGlb glb;
  const auto json_size = TakeValue<uint32_t>(&at);
  EXPECT_EQ(TakeValue<uint32_t>(&at), 0x4e4f534au);
  EXPECT_EQ(json_size % 4, 0u);
  glb.json = nlohmann::json::parse(std::string(at, json_size));
  at += json_size;
  if (at == bytes.data() + bytes.size()) return glb;
  const auto data_size = TakeValue<uint32_t>(&at);
  EXPECT_EQ(TakeValue<uint32_t>(&at), 0x004e4942u);
  glb.data = std::string(at, data_size);
  EXPECT_EQ(at + data_size, bytes.data() + bytes.size());
  EXPECT_EQ(glb.json["buffers"][0]["byteLength"], data_size);
  return glb;
}

PlainGlb JoinedGlb(MeshFilesCity* city, int64_t most_triangles = kMostGlbTriangles, Warnings* warnings = nullptr) {
  JoinInput input = city->Input();
  input.warnings = warnings;
  const StatusOr<std::vector<std::string>> files = JoinGlbOf(input, city->folder.path(), {}, most_triangles);
  EXPECT_TRUE(files.ok()) << files.status();
  EXPECT_THAT(*files, testing::ElementsAre("mesh.glb"));
  return ReadPlainGlb(city->folder.path() + "/mesh.glb");
}

// Earth-centred positions of the vertices, by what the file says alone.
std::vector<Vector3d> EarthPositions(const PlainGlb& glb) {
  const nlohmann::json& origin = glb.json["asset"]["extras"]["origin"];
  const double lat = origin["latitude_deg"].get<double>() * std::numbers::pi / 180;
  const double lon = origin["longitude_deg"].get<double>() * std::numbers::pi / 180;
  const Vector3d east(-std::sin(lon), std::cos(lon), 0);
  const Vector3d north(-std::sin(lat) * std::cos(lon), -std::sin(lat) * std::sin(lon), std::cos(lat));
  const Vector3d up = east.cross(north);
  const Vector3d start = GeocentricFromGeodetic({lat, lon, origin["height_m"].get<double>()});
  const nlohmann::json& translation = glb.json["nodes"][0]["translation"];
  const std::vector<float> values = glb.Values<float>(0, 3, 12);
  std::vector<Vector3d> positions;
  for (size_t i = 0; i < values.size(); i += 3) {
    Vector3d p;
    for (int k = 0; k < 3; ++k) p[k] = translation[k].get<double>() + values[i + k];
    positions.push_back(start + p.x() * east + p.y() * up - p.z() * north);
  }
  return positions;
}

TEST(GlbExportTest, PlacesEachVertexOnTheGlobe) {
  MeshFilesCity city(VertexColor::kClass);
  const PlainGlb glb = JoinedGlb(&city);
  const std::vector<Vector3d> positions = EarthPositions(glb);
  ASSERT_EQ(positions.size(), 23u * 9);
  for (size_t v = 0; v < city.sheets[0].vertices.size(); ++v) {
    const Vector3d expected = GeocentricFromGeodetic(*city.scene.frame.GeodeticFromLocal(city.sheets[0].vertices[v]));
    EXPECT_LT((positions[v] - expected).norm(), 0.002) << v;
  }
  const nlohmann::json& extras = glb.json["asset"]["extras"];
  EXPECT_EQ(extras["reference_point"]["coordinates"][0], city.scene.frame.origin_in_scene().x());
  EXPECT_EQ(extras["quarantined_sheets"], nlohmann::json::array({"1_0"}));
  EXPECT_FALSE(extras.contains("triangles_before_simplification"));
}

TEST(GlbExportTest, GivesEachClassAPrimitiveAndAMaterial) {
  MeshFilesCity city(VertexColor::kClass);
  const PlainGlb glb = JoinedGlb(&city);
  const nlohmann::json& primitives = glb.json["meshes"][0]["primitives"];
  ASSERT_EQ(primitives.size(), 3u);  // unlabelled, ground and the class with a hostile name
  EXPECT_EQ(glb.json["materials"][0]["name"], "unlabelled");
  EXPECT_EQ(glb.json["materials"][1]["name"], "ground");
  EXPECT_EQ(glb.json["materials"][2]["name"], "\"</script><img src=x onerror=alert(1)>\xef\xbf\xbd");
  // 10 / 255 in sRGB is 0.003 in linear light.
  EXPECT_NEAR(glb.json["materials"][1]["pbrMetallicRoughness"]["baseColorFactor"][0].get<double>(), 0.00304, 1e-5);
  size_t faces = 0;
  for (const nlohmann::json& primitive : primitives) {
    EXPECT_FALSE(primitive["attributes"].contains("COLOR_0"));
    const std::vector<uint32_t> indices = glb.Values<uint32_t>(primitive["indices"].get<int>(), 1, 4);
    const int32_t label = glb.json["materials"][primitive["material"].get<size_t>()]["extras"]["class"];
    size_t expected = 0;
    for (const Sheet& sheet : city.sheets) {
      expected += static_cast<size_t>(std::count(sheet.labels.begin(), sheet.labels.end(), label));
    }
    EXPECT_EQ(indices.size(), 3 * expected) << label;
    for (const uint32_t index : indices) EXPECT_LT(index, 23u * 9);
    faces += indices.size() / 3;
  }
  EXPECT_EQ(faces, city.sheets[0].faces.size() + city.sheets[1].faces.size());
}

TEST(GlbExportTest, WritesColoursInLinearLight) {
  MeshFilesCity city(VertexColor::kImage);
  const PlainGlb glb = JoinedGlb(&city);
  const std::vector<uint16_t> colors = glb.Values<uint16_t>(1, 4, 8);
  ASSERT_EQ(colors.size(), 4u * 23 * 9);
  // 128 in sRGB is 0.2159 in linear light.
  EXPECT_NEAR(colors[2] / 65535.0, 0.21586, 1e-4);
  EXPECT_EQ(colors[3], 65535);
  EXPECT_EQ(glb.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"], nlohmann::json({1, 1, 1, 1}));
  EXPECT_TRUE(glb.json["materials"][0]["extensions"].contains("KHR_materials_unlit"));
  for (const VertexColor color : {VertexColor::kConfidence, VertexColor::kDisplacement}) {
    MeshFilesCity other(color);
    const PlainGlb file = JoinedGlb(&other);
    EXPECT_TRUE(file.json["meshes"][0]["primitives"][0]["attributes"].contains("COLOR_0"));
    EXPECT_EQ(file.json["asset"]["extras"]["legend"].size(), 5u);
  }
}

TEST(GlbExportTest, SimplifiesToTheMostTrianglesWithoutCracks) {
  MeshFilesCity city(VertexColor::kImage, {Relief(0, 60, 80, 0.25), Relief(60, 130, 80, 0.25)});
  Warnings warnings;
  const PlainGlb glb = JoinedGlb(&city, 2000, &warnings);
  EXPECT_THAT(warnings, testing::ElementsAre(testing::HasSubstr("glb: simplified from 20800 to ")));
  const nlohmann::json& extras = glb.json["asset"]["extras"];
  EXPECT_EQ(extras["triangles_before_simplification"], 130 * 80 * 2);
  std::vector<uint32_t> corners;
  for (const nlohmann::json& primitive : glb.json["meshes"][0]["primitives"]) {
    const std::vector<uint32_t> indices = glb.Values<uint32_t>(primitive["indices"].get<int>(), 1, 4);
    corners.insert(corners.end(), indices.begin(), indices.end());
  }
  EXPECT_LE(corners.size(), 3u * 2000);
  EXPECT_GT(corners.size(), 3u * 500);
  // Edges with one face lie on the outline of the city.
  const std::vector<float> positions = glb.Values<float>(0, 3, 12);
  std::map<std::pair<uint32_t, uint32_t>, int> faces_at;
  for (size_t i = 0; i < corners.size(); ++i) {
    const uint32_t a = corners[i], b = corners[i - i % 3 + (i + 1) % 3];
    ++faces_at[std::minmax(a, b)];
  }
  float low_x = 1e9f, high_x = -1e9f;
  for (size_t i = 0; i < positions.size(); i += 3) {
    low_x = std::min(low_x, positions[i]);
    high_x = std::max(high_x, positions[i]);
  }
  const float seam_x = low_x + (high_x - low_x) * 60 / 130;
  for (const auto& [edge, faces] : faces_at) {
    const float x = 0.5f * (positions[3 * edge.first] + positions[3 * edge.second]);
    const float z = 0.5f * (positions[3 * edge.first + 2] + positions[3 * edge.second + 2]);
    if (std::abs(x - seam_x) < 2 && std::abs(z) < 7) {
      EXPECT_GE(faces, 2) << x << " " << z;
    }
  }
}

TEST(GlbExportTest, WritesASceneWithoutPlaceUpright) {
  MeshFilesCity city(VertexColor::kClass);
  city.scene.frame = Frame();
  city.scene.up = Vector3d::UnitX();
  city.scene.ground = MakeGroundPlane(city.scene.up, 8);
  const PlainGlb glb = JoinedGlb(&city);
  const std::vector<float> values = glb.Values<float>(0, 3, 12);
  const double height = glb.json["nodes"][0]["translation"][1].get<double>() + values[1];
  EXPECT_NEAR(height, city.sheets[0].vertices[0].x(), 1e-5);
  EXPECT_FALSE(glb.json["asset"]["extras"].contains("origin"));
}

TEST(GlbExportTest, WritesAnEmptyScene) {
  MeshFilesCity city(VertexColor::kImage, {});
  const PlainGlb glb = JoinedGlb(&city);
  EXPECT_FALSE(glb.json.contains("meshes"));
  EXPECT_TRUE(glb.data.empty());
}

TEST(MeshFilesTest, HaveTheSameBytesAgainAndNoTemporaryFiles) {
  MeshFilesCity city(VertexColor::kImage), again(VertexColor::kImage);
  for (MeshFilesCity* each : {&city, &again}) {
    JoinedGlb(each);
    JoinedPly(each);
  }
  for (const std::string name : {"/mesh.glb", "/mesh.ply"}) {
    EXPECT_EQ(*ReadFile(city.folder.path() + name), *ReadFile(again.folder.path() + name)) << name;
  }
  EXPECT_EQ(ListFiles(city.folder.path())->size(), 6u);  // two sheets, two parts, two results
}

TEST(MeshFilesTest, ReportDamagedSheets) {
  MeshFilesCity city(VertexColor::kImage);
  const JoinInput input = city.Input();
  ASSERT_TRUE(WriteFileAtomic(input.sheets[1].sheet_path, "x").ok());
  ASSERT_TRUE(WriteFileAtomic(input.sheets[1].part_path, "x").ok());
  EXPECT_FALSE(JoinPly(input, city.folder.path(), {}).ok());
  EXPECT_FALSE(JoinGlb(input, city.folder.path(), {}).ok());
  EXPECT_FALSE(FileExists(city.folder.path() + "/mesh.ply"));
  EXPECT_FALSE(FileExists(city.folder.path() + "/mesh.glb"));
}

TEST(ClusteredMeshTest, KeepsCornersAndPlanes) {
  // A box with edges of 7.3 m, of squares of 0.1 m: clusters at corners move to them, others to edges and planes.
  Sheet box;
  constexpr int kCells = 73;
  PositionIndex index;
  for (int side = 0; side < 6; ++side) {
    const int axis = side / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (int i = 0; i < kCells; ++i) {
      for (int j = 0; j < kCells; ++j) {
        uint32_t corners[4];
        for (int k = 0; k < 4; ++k) {
          Vector3d p;
          p[axis] = side % 2 * 7.3;
          p[u] = 0.1 * (i + (k == 1 || k == 2));
          p[v] = 0.1 * (j + k / 2);
          corners[k] = index.NumberOf(p + Vector3d::Constant(0.013));
        }
        if (side % 2 == 0) std::swap(corners[1], corners[3]);
        box.faces.push_back({corners[0], corners[1], corners[2]});
        box.faces.push_back({corners[0], corners[2], corners[3]});
      }
    }
  }
  box.vertices = index.positions();
  box.labels.assign(box.faces.size(), 0);
  ClusteredMesh clustered(1.0);
  clustered.Add(box);
  const Sheet small = clustered.Take();
  EXPECT_LT(small.faces.size(), 800u);
  for (const Vector3d& p : small.vertices) {
    const Vector3d q = p - Vector3d::Constant(0.013);
    const double off = std::min((q.cwiseAbs()).minCoeff(), (q.array() - 7.3).abs().minCoeff());
    EXPECT_LT(off, 1e-6) << q.transpose();
  }
  const auto distance_to = [&](const Vector3d& corner) {
    double nearest = 1e9;
    for (const Vector3d& p : small.vertices) nearest = std::min(nearest, (p - corner).norm());
    return nearest;
  };
  EXPECT_LT(distance_to(Vector3d::Constant(0.013)), 1e-6);
  EXPECT_LT(distance_to(Vector3d::Constant(7.313)), 1e-6);
  // Closed: each edge has two faces.
  std::map<std::pair<uint32_t, uint32_t>, int> faces_at;
  for (const Triangle& face : small.faces) {
    for (int k = 0; k < 3; ++k) ++faces_at[std::minmax(face[k], face[(k + 1) % 3])];
  }
  for (const auto& [edge, faces] : faces_at) EXPECT_EQ(faces, 2);
}

TEST(WeldedVerticesTest, NumbersVerticesAtTheSamePositionOnce) {
  const Sheet first = Relief(0, 10, 8), second = Relief(10, 22, 8);
  WeldedVertices welded;
  ASSERT_TRUE(welded.Add(first).ok());
  ASSERT_TRUE(welded.Add(second).ok());
  EXPECT_EQ(welded.count(), 23 * 9);
  const CityVertices a = welded.Of(0, first), b = welded.Of(1, second);
  std::set<uint32_t> numbers(a.numbers.begin(), a.numbers.end());
  EXPECT_EQ(numbers.size(), first.vertices.size());
  EXPECT_EQ(a.new_vertices.size(), first.vertices.size());
  EXPECT_EQ(b.new_vertices.size(), second.vertices.size() - 9);
  for (size_t v = 0; v < second.vertices.size(); ++v) {
    EXPECT_EQ(numbers.contains(b.numbers[v]), second.vertices[v].x() == 5) << v;
  }
}

}  // namespace
}  // namespace tessera
