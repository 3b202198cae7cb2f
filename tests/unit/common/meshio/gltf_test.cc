#include "common/meshio/gltf.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>

#include "common/meshio/mesh_format.h"
#include "tests/support/meshes/write_gltf.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// A square of two triangles in the plane z = 0 of the file.
const std::vector<float> kGltfSquare = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};

// One mesh with these primitives in one node with this transform.
std::string OneGltfMesh(const std::string& primitives, const std::string& transform = "") {
  return absl::StrCat("\"meshes\":[{\"primitives\":[", primitives, "]}],\"nodes\":[{\"mesh\":0", transform,
                      "}],\"scenes\":[{\"nodes\":[0]}]");
}

std::string SquareGltf(const std::string& more_of_primitive = "", const std::string& transform = "") {
  GltfBuffer buffer;
  const int positions = buffer.AddPositions(kGltfSquare), indices = buffer.AddIndices({0, 1, 2, 0, 2, 3});
  return buffer.Text(OneGltfMesh(
      absl::StrCat("{\"attributes\":{\"POSITION\":", positions, "},\"indices\":", indices, more_of_primitive, "}"),
      transform));
}

MeshContent GltfMesh(const std::string& bytes, const MeshReadOptions& options = {}) {
  StatusOr<MeshContent> content = ParseGltf(bytes, "city.glb", options);
  EXPECT_TRUE(content.ok()) << content.status();
  return content.ok() ? *std::move(content) : MeshContent();
}

std::string GltfError(const std::string& bytes, const MeshReadOptions& options = {}) {
  const StatusOr<MeshContent> content = ParseGltf(bytes, "city.glb", options);
  EXPECT_FALSE(content.ok());
  EXPECT_EQ(content.status().code(), absl::StatusCode::kInvalidArgument) << content.status();
  return std::string(content.status().message());
}

std::string GltfReplaced(std::string text, const std::string& from, const std::string& to) {
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

TEST(Gltf, TurnsTheUpAxisFromYToZ) {
  GltfBuffer buffer;
  const int positions = buffer.AddPositions({1, 2, 3, 4, 5, 6, 7, 8, 10});
  const std::string rest = OneGltfMesh(absl::StrCat("{\"attributes\":{\"POSITION\":", positions, "}}"));
  for (const std::string& bytes : {buffer.Text(rest), buffer.Binary(rest)}) {
    const MeshContent content = GltfMesh(bytes);
    EXPECT_EQ(content.mesh.vertices, (std::vector<Eigen::Vector3d>{{1, -3, 2}, {4, -6, 5}, {7, -10, 8}}));
    EXPECT_EQ(content.mesh.faces, (std::vector<Triangle>{{0, 1, 2}}));
    EXPECT_THAT(content.mesh.labels, IsEmpty());
  }
}

TEST(Gltf, PlacesNodesInDoublePrecision) {
  // A parent at UTM coordinates, a child that is turned by 90 degrees about y and scaled.
  GltfBuffer buffer;
  buffer.AddPositions({1, 0, 0, 0, 1, 0, 0, 0, 1});
  const std::string bytes = buffer.Text(absl::StrCat(
      "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],\"scene\":0,\"scenes\":[{\"nodes\":[1]}],"
      "\"nodes\":[{\"mesh\":0,\"rotation\":[0,0.7071067811865476,0,0.7071067811865476],\"scale\":[2,3,4],"
      "\"translation\":[0.5,0,0]},{\"children\":[0],\"matrix\":[1,0,0,0,0,1,0,0,0,0,1,0,691000.25,500,-5334000.125,1]}"
      "]"));
  const MeshContent content = GltfMesh(bytes);
  // About y: x becomes -z, z becomes x. In the file (691000.75, 500, -5334002.125) and so on.
  const std::vector<Eigen::Vector3d> expected = {
      {691000.75, 5334002.125, 500}, {691000.75, 5334000.125, 503}, {691004.75, 5334000.125, 500}};
  ASSERT_EQ(content.mesh.vertices.size(), 3u);
  for (size_t v = 0; v < 3; ++v) {
    EXPECT_LT((content.mesh.vertices[v] - expected[v]).norm(), 1e-8) << content.mesh.vertices[v].transpose();
  }
}

TEST(Gltf, MirroredNodesKeepTheirFrontFaces) {
  const MeshContent plain = GltfMesh(SquareGltf()), mirrored = GltfMesh(SquareGltf("", ",\"scale\":[-1,1,1]"));
  ASSERT_EQ(mirrored.mesh.faces.size(), 2u);
  for (size_t f = 0; f < 2; ++f) {
    EXPECT_LT((FaceNormal(plain.mesh, f) - Eigen::Vector3d(0, -1, 0)).norm(), 1e-12);
    EXPECT_LT((FaceNormal(mirrored.mesh, f) - Eigen::Vector3d(0, -1, 0)).norm(), 1e-12);
  }
}

TEST(Gltf, VerticesAtOnePositionBecomeOne) {
  // Two primitives of two nodes share an edge, and the first has a seam with repeated vertices.
  GltfBuffer buffer;
  buffer.AddPositions({0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 0, 0, 1, 0});
  buffer.AddPositions({-1, 0, 0, 0, 0, 0, -0.0f, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0});
  Warnings warnings;
  MeshReadOptions options;
  options.warnings = &warnings;
  options.file_in_warnings = "city.glb";
  const MeshContent content = GltfMesh(
      buffer.Text("\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]},{\"primitives\":[{\"attributes\":{"
                  "\"POSITION\":1}}]}],\"nodes\":[{\"mesh\":0},{\"mesh\":1}]"),
      options);
  EXPECT_EQ(content.mesh.vertices,
            (std::vector<Eigen::Vector3d>{{0, 0, 0}, {1, 0, 0}, {1, 0, 1}, {0, 0, 1}, {-1, 0, 0}}));
  EXPECT_EQ(content.mesh.faces, (std::vector<Triangle>{{0, 1, 2}, {0, 2, 3}, {4, 0, 3}}));
  EXPECT_THAT(warnings, ElementsAre("city.glb: 1 faces with two corners at one position left out"));
}

TEST(Gltf, ReadsStripsFansAndIndicesOfAllTypes) {
  GltfBuffer buffer;
  buffer.AddPositions(kGltfSquare);
  buffer.Add<uint8_t>({0, 1, 3, 2}, 5121, "SCALAR");
  buffer.Add<uint16_t>({0, 1, 2, 3}, 5123, "SCALAR");
  Warnings warnings;
  MeshReadOptions options;
  options.warnings = &warnings;
  const MeshContent content =
      GltfMesh(buffer.Text(OneGltfMesh("{\"attributes\":{\"POSITION\":0},\"indices\":1,\"mode\":5},"
                                       "{\"attributes\":{\"POSITION\":0},\"indices\":2,\"mode\":6},"
                                       "{\"attributes\":{\"POSITION\":0},\"mode\":6},"
                                       "{\"attributes\":{\"POSITION\":0},\"mode\":0},"
                                       "{\"attributes\":{\"POSITION\":0},\"mode\":3}")),
               options);
  // Vertices are numbered by their first use: 0, 1, 3, 2 of the square.
  EXPECT_EQ(content.mesh.faces,
            (std::vector<Triangle>{{0, 1, 2}, {1, 3, 2}, {0, 1, 3}, {0, 3, 2}, {0, 1, 3}, {0, 3, 2}}));
  for (size_t f = 0; f < content.mesh.faces.size(); ++f) EXPECT_LT(FaceNormal(content.mesh, f).y(), -0.99) << f;
  EXPECT_THAT(warnings, ElementsAre(HasSubstr("2 primitives of points or lines left out")));
}

TEST(Gltf, ReadsQuantisedPositions) {
  GltfBuffer buffer;
  buffer.Add<int16_t>({0, 0, 0, 32767, 0, 0, 0, -32767, 0}, 5122, "VEC3", ",\"normalized\":true");
  const MeshContent content =
      GltfMesh(buffer.Text(absl::StrCat("\"extensionsRequired\":[\"KHR_mesh_quantization\"],",
                                        OneGltfMesh("{\"attributes\":{\"POSITION\":0}}", ",\"scale\":[10,20,1]"))));
  EXPECT_EQ(content.mesh.vertices, (std::vector<Eigen::Vector3d>{{0, 0, 0}, {10, 0, 0}, {0, 0, -20}}));
}

TEST(Gltf, MaterialsAreLabelsWhereAskedFor) {
  GltfBuffer buffer;
  buffer.AddPositions(kGltfSquare);
  const std::string bytes =
      buffer.Text(OneGltfMesh("{\"attributes\":{\"POSITION\":0},\"material\":1},{\"attributes\":{\"POSITION\":0}},"
                              "{\"attributes\":{\"POSITION\":0},\"material\":0}") +
                  ",\"materials\":[{},{\"name\":\"roof\"}]");
  MaterialNames materials;
  MeshReadOptions options;
  options.materials = &materials;
  const MeshContent content = GltfMesh(bytes, options);
  EXPECT_THAT(content.mesh.labels, ElementsAre(0, -1, 1));
  EXPECT_THAT(materials.names(), ElementsAre("roof", "material 0"));
  EXPECT_THAT(GltfMesh(bytes).mesh.labels, IsEmpty());
}

TEST(Gltf, AVertexAttributeIsTheLabelWhereItIsNamed) {
  GltfBuffer buffer;
  buffer.AddPositions({0, 0, 0, 1, 0, 0, 1, 1, 0, 2, 0, 0, 3, 0, 0, 3, 1, 0});
  buffer.Add<float>({4, 4, 2, 7, 7, 7}, 5126, "SCALAR");
  buffer.Add<float>({4, 4, 2.5f, 7, 7, 7}, 5126, "SCALAR");
  MeshReadOptions options;
  options.label_property = "_CLASS";
  const std::string bytes = buffer.Text(OneGltfMesh("{\"attributes\":{\"POSITION\":0,\"_CLASS\":1}}"));
  const MeshContent content = GltfMesh(bytes, options);
  EXPECT_THAT(content.mesh.labels, ElementsAre(4, 7));
  EXPECT_EQ(content.label_property, "_CLASS");
  EXPECT_THAT(GltfError(buffer.Text(OneGltfMesh("{\"attributes\":{\"POSITION\":0,\"_CLASS\":2}}")), options),
              HasSubstr("meshes[0].primitives[0]._CLASS: vertex 2: found label 2.5, expected a class index"));
  options.label_property = "_FEATURE_ID_0";
  EXPECT_THAT(GltfError(bytes, options), HasSubstr("meshes: found no vertex attribute '_FEATURE_ID_0'"));
}

TEST(Gltf, ReadsFilesBesideItAndNoOthers) {
  GltfBuffer buffer;
  buffer.AddPositions(kGltfSquare);
  const std::string rest = OneGltfMesh("{\"attributes\":{\"POSITION\":0}}"),
                    folder = testing::TempDir() + "/gltf_beside";
  std::filesystem::create_directories(folder);
  std::ofstream(folder + "/a b.bin", std::ios::binary) << buffer.bytes();
  std::ofstream(testing::TempDir() + "/above.bin", std::ios::binary) << buffer.bytes();
  const auto read = [&](const std::string& uri) {
    std::ofstream(folder + "/city.gltf", std::ios::binary) << buffer.Json(rest, uri);
    return ReadMesh(folder + "/city.gltf");
  };
  const StatusOr<MeshContent> content = read("a%20b.bin");
  ASSERT_TRUE(content.ok()) << content.status();
  EXPECT_EQ(content->mesh.faces.size(), 1u);
  for (const char* const uri : {"../above.bin", "%2e%2e/above.bin", "/etc/passwd", "file:///etc/passwd"}) {
    EXPECT_THAT(std::string(read(uri).status().message()), HasSubstr("buffers[0].uri: found ")) << uri;
  }
  EXPECT_EQ(read("none.bin").status().code(), absl::StatusCode::kNotFound);
  std::ofstream(folder + "/a b.bin", std::ios::binary) << buffer.bytes().substr(1);
  EXPECT_THAT(std::string(read("a%20b.bin").status().message()), HasSubstr("buffers[0]: found 47 bytes, expected 48"));
}

TEST(Gltf, IsToldByItsContent) {
  const std::string path = testing::TempDir() + "/told_gltf.ply";
  for (const std::string& bytes : {SquareGltf(), "\n " + SquareGltf()}) {
    std::ofstream(path, std::ios::binary) << bytes;
    const StatusOr<MeshContent> content = ReadMesh(path);
    ASSERT_TRUE(content.ok()) << content.status();
    EXPECT_EQ(content->mesh.faces.size(), 2u);
    EXPECT_TRUE(*HasMoreFaces(path, 1));
    EXPECT_FALSE(*HasMoreFaces(path, 2));
  }
  EXPECT_TRUE(IsGltf("glTF\x02"));
  EXPECT_FALSE(IsGltf("{\"cameras\": []}"));
  EXPECT_FALSE(HeadHasLabels("glTF\x02"));
}

TEST(Gltf, CompressedFilesAreRefusedWithWhatToDo) {
  const std::string remedy = "export again without Draco and meshopt";
  EXPECT_THAT(GltfError(GltfReplaced(SquareGltf(), "\"meshes\"",
                                     "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"],\"meshes\"")),
              AllOf(HasSubstr("extensionsRequired: found 'KHR_draco_mesh_compression'"), HasSubstr(remedy)));
  EXPECT_THAT(GltfError(SquareGltf(",\"extensions\":{\"KHR_draco_mesh_compression\":{}}")),
              AllOf(HasSubstr("meshes[0].primitives[0]: found 'KHR_draco_mesh_compression'"), HasSubstr(remedy)));
  EXPECT_THAT(GltfError(GltfReplaced(SquareGltf(), "\"byteLength\":48}",
                                     "\"byteLength\":48,\"extensions\":{\"EXT_meshopt_"
                                     "compression\":{}}}")),
              AllOf(HasSubstr("bufferViews[0]: found 'EXT_meshopt_compression'"), HasSubstr(remedy)));
  EXPECT_THAT(GltfError(GltfReplaced(SquareGltf(), "\"meshes\"", "\"extensionsRequired\":[\"X_y\"],\"meshes\"")),
              HasSubstr("extensionsRequired: found 'X_y', expected a file that does not need it"));
}

TEST(Gltf, ErrorsHaveTheirPlace) {
  const std::string good = SquareGltf();
  const auto with = [&](const std::string& from, const std::string& to) {
    return GltfError(GltfReplaced(good, from, to));
  };
  EXPECT_THAT(with("\"2.0\"", "\"1.0\""),
              HasSubstr("asset.version: found '\"1.0\"', expected 2.0: export as glTF 2.0"));
  EXPECT_THAT(
      with("\"count\":4", "\"count\":5"),
      HasSubstr("accessors[0]: found 5 values, 12 bytes apart, from byte 0 on, expected a part of the 48 bytes"));
  EXPECT_THAT(with("\"count\":4", "\"count\":9007199254740992"), HasSubstr("accessors[0]: found 9007199254740992 val"));
  EXPECT_THAT(with("\"count\":4", "\"count\":-4"),
              HasSubstr("accessors[0].count: found '-4', expected a whole number"));
  EXPECT_THAT(with("\"count\":4", "\"count\":2"), HasSubstr("primitives[0].indices: found vertex 2, expected 0 to 1"));
  EXPECT_THAT(with("\"VEC3\"", "\"VEC2\""), HasSubstr("accessors[0].type: found '\"VEC2\"', expected 'VEC3'"));
  EXPECT_THAT(with("5126", "5130"), HasSubstr("accessors[0].componentType: found 5130"));
  EXPECT_THAT(with("5125", "5126"), HasSubstr("primitives[0].indices: found componentType 5126"));
  EXPECT_THAT(with("\"bufferView\":0", "\"bufferView\":7"), HasSubstr("accessors[0].bufferView: found index 7"));
  EXPECT_THAT(with("\"bufferView\":0,", ""), HasSubstr("accessors[0].bufferView: found no index"));
  EXPECT_THAT(with("\"bufferView\":0,", "\"bufferView\":0,\"sparse\":{},"), HasSubstr("accessors[0]: found sparse"));
  EXPECT_THAT(with("\"bufferView\":0,", "\"bufferView\":0,\"byteOffset\":18446744073709551615,"),
              HasSubstr("accessors[0].byteOffset: found"));
  EXPECT_THAT(with("\"byteOffset\":48", "\"byteOffset\":49"), HasSubstr("bufferViews[1]: found 24 bytes from byte 49"));
  EXPECT_THAT(with("\"byteLength\":72", "\"byteLength\":73"), HasSubstr("buffers[0]: found 72 bytes, expected 73"));
  EXPECT_THAT(with("base64,", "base64,!"), HasSubstr("buffers[0].uri: found a damaged data URI"));
  EXPECT_THAT(with("{\"mesh\":0", "{\"mesh\":1"), HasSubstr("nodes[0].mesh: found index 1, expected one of the 1"));
  EXPECT_THAT(with("{\"mesh\":0", "{\"mesh\":0,\"rotation\":[0,0,0,2]"), HasSubstr("nodes[0].rotation: found"));
  EXPECT_THAT(with("{\"mesh\":0", "{\"mesh\":0,\"matrix\":[1,2]"), HasSubstr("nodes[0].matrix: found a list of 2"));
  EXPECT_THAT(with("{\"mesh\":0", "{\"mesh\":0,\"children\":[0]"), HasSubstr("nodes[0]: found a node with several"));
  EXPECT_THAT(with("\"nodes\":[0]", "\"nodes\":[3]"), HasSubstr("nodes: found index 3"));
  EXPECT_THAT(with("\"asset\"", "asset"), HasSubstr("byte 2: found damaged JSON"));
  EXPECT_THAT(with("\"asset\"", "\"a\":1e999,\"asset\""), HasSubstr("found damaged JSON"));
  GltfBuffer buffer;
  buffer.AddPositions({0, 0, 0, 1, 0, 0, NAN, 0, 0});
  const std::string rest = OneGltfMesh("{\"attributes\":{\"POSITION\":0}}"), binary = buffer.Binary(rest);
  EXPECT_THAT(GltfError(binary), HasSubstr("primitives[0].POSITION: vertex 2: found coordinates that are not finite"));
  EXPECT_THAT(GltfError(binary.substr(0, binary.size() - 1)), HasSubstr("byte 8: found a length of"));
  EXPECT_THAT(GltfError(binary.substr(0, 10)), HasSubstr("byte 0: found 10 bytes"));
  EXPECT_THAT(GltfError(GltfReplaced(binary, "glTF\x02", "glTF\x01")), HasSubstr("byte 4: found version 1"));
  EXPECT_THAT(GltfError(GltfReplaced(binary, "BIN", "BIM")), HasSubstr("buffers[0]: found 36 bytes without a URI"));
}

// A small file may place its mesh many times.
TEST(Gltf, BoundsWhatNodesPlace) {
  GltfBuffer buffer;
  buffer.Add<uint8_t>(std::vector<uint8_t>(3'000'000), 5121, "VEC3", ",\"normalized\":false");
  std::string nodes, roots;
  for (int k = 0; k < 5000; ++k) {
    absl::StrAppend(&nodes, k == 0 ? "" : ",", "{\"mesh\":0}");
    absl::StrAppend(&roots, k == 0 ? "" : ",", k);
  }
  buffer.Add<uint8_t>(std::vector<uint8_t>(1), 5121, "SCALAR");
  EXPECT_THAT(GltfError(buffer.Binary(absl::StrCat(
                  "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1}]}],\"nodes\":[", nodes,
                  "],\"scenes\":[{\"nodes\":[", roots, "]}]"))),
              HasSubstr("vertices and corners in all nodes"));
}

}  // namespace
}  // namespace tessera
