#include "common/meshio/obj.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>

#include "common/meshio/mesh_format.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr char kFourVertices[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\n";

std::string ObjError(const std::string& bytes) {
  const StatusOr<MeshContent> content = ParseObj(bytes, "city.obj");
  EXPECT_FALSE(content.ok()) << bytes;
  EXPECT_EQ(content.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(content.status().message());
}

TEST(Obj, ReadsVerticesAndFaces) {
  const std::string text =
      "\xef\xbb\xbf# Blender v3.0.0 OBJ File\r\nmtllib city.mtl\r\no Cube\r\nv 0 0 0\r\nv 1.5e0 0 0 1 0.5 0.25\r\n"
      "\tv  +1 1 -0.25\r\nv 0 1 0.5\r\nvt 0.5 0.5\r\nvn 0 0 1\r\ng roof\r\nusemtl red\r\ns off\r\n\r\n"
      "f 1 2 3\r\nf 1/1 2/1 4/1 # with a comment\r\nf 1//1 -2//1 -1//1\r\nl 1 2\r\nf 1/1/1 2/1/1 3/1/1 4/1/1\r\n"
      "f 4 3 \\\r\n  2\r\n";
  Warnings warnings;
  const StatusOr<MeshContent> content = ParseObj(text, "city.obj", {{}, &warnings, "city.obj"});
  ASSERT_TRUE(content.ok()) << content.status();
  EXPECT_EQ(content->mesh.vertices, (std::vector<Eigen::Vector3d>{{0, 0, 0}, {1.5, 0, 0}, {1, 1, -0.25}, {0, 1, 0.5}}));
  EXPECT_EQ(content->mesh.faces,
            (std::vector<Triangle>{{0, 1, 2}, {0, 1, 3}, {0, 2, 3}, {0, 1, 2}, {0, 2, 3}, {3, 2, 1}}));
  EXPECT_THAT(content->mesh.labels, IsEmpty());
  EXPECT_FALSE(content->float_positions);
  EXPECT_THAT(warnings,
              ElementsAre("city.obj: a byte order mark before the first line ignored",
                          "city.obj: 1 faces of more than 3 vertices split into 2 triangles (first: line 18)"));
}

TEST(Obj, FacesMayPrecedeTheirVertices) {
  const StatusOr<MeshContent> content = ParseObj(std::string("f 1 2 3\n") + kFourVertices, "city.obj");
  ASSERT_TRUE(content.ok()) << content.status();
  EXPECT_EQ(content->mesh.faces, (std::vector<Triangle>{{0, 1, 2}}));
  EXPECT_EQ(ObjError(std::string("v 0 0 0\nf 1 2 3\nf 1 2 5\n") + kFourVertices + "f 1 2 6\n"),
            "city.obj: line 8: found vertex index 6, expected 1 to 5, or -1 to -5 from the last vertex");
}

TEST(Obj, ErrorsHaveTheirLine) {
  const std::string good = kFourVertices;
  EXPECT_EQ(ObjError(good + "f 1 2 5\n"),
            "city.obj: line 5: found vertex index 5, expected 1 to 4, or -1 to -4 from the last vertex");
  EXPECT_THAT(ObjError(good + "f 0 1 2\n"), HasSubstr("line 5: found vertex index 0, expected 1 to 4"));
  EXPECT_THAT(ObjError(good + "f -1 -2 -5\n"), HasSubstr("line 5: found vertex index -5, expected 1 to 4"));
  EXPECT_THAT(ObjError(good + "f 1 2 4294967297\n"), HasSubstr("line 5: found vertex index 4294967297"));
  EXPECT_THAT(ObjError(good + "f 1 2 99999999999999999999\n"), HasSubstr("line 5: found face vertex '9999"));
  EXPECT_THAT(ObjError(good + "f 1 2 3.5\n"), HasSubstr("line 5: found face vertex '3.5', expected an index"));
  EXPECT_THAT(ObjError(good + "f 1 2 x\n"), HasSubstr("line 5: found face vertex 'x'"));
  EXPECT_THAT(ObjError(good + "f 1 2 /3\n"), HasSubstr("line 5: found face vertex '/3'"));
  EXPECT_THAT(ObjError(good + "f 1 2\n"), HasSubstr("line 5: found a face of 2 vertices, expected 3 to 1000 vertices"));
  EXPECT_THAT(ObjError(good + "f\n"), HasSubstr("line 5: found a face of 0 vertices"));
  std::string many = "f";
  for (int k = 0; k < 1001; ++k) many += " 1";
  EXPECT_THAT(ObjError(good + many + "\n"), HasSubstr("line 5: found a face of more than 1000 vertices"));
  EXPECT_THAT(ObjError(good + "v 1 2\n"), HasSubstr("line 5: found a vertex of 2 coordinates, expected 3"));
  EXPECT_THAT(ObjError(good + "v 1 2 nan\n"), HasSubstr("line 5: found coordinate 'nan', expected a finite number"));
  EXPECT_THAT(ObjError(good + "v 1,5 2 3\n"), HasSubstr("line 5: found coordinate '1,5'"));
  EXPECT_THAT(ObjError(good + "curv 0 1 1 2\n"), HasSubstr("line 5: found 'curv', expected a statement of a polygon"));
  EXPECT_THAT(ObjError(good + std::string(2 << 20, 'f')), HasSubstr("line 5: found a line of more than 1048576 bytes"));
  const StatusOr<MeshContent> named = ParseObj(good, "city.obj", {"class", nullptr, ""});
  EXPECT_EQ(named.status().message(),
            "city.obj: found an OBJ file, which has no properties, expected a PLY with the property 'class', which "
            "scene.json names in \"label_property\"");
}

TEST(Obj, MaterialsAreLabelsWhereAskedFor) {
  const std::string text = std::string(kFourVertices) +
                           "f 1 2 3\nusemtl old roof \r\nf 1 2 3\nf 1 2 3 4\nusemtl wall\nf 1 2 4\nusemtl old roof\n"
                           "f 2 3 4\nusemtl\nf 1 3 4\n";
  MaterialNames materials;
  materials.IndexOf("of an earlier file");
  MeshReadOptions options;
  options.materials = &materials;
  const StatusOr<MeshContent> content = ParseObj(text, "city.obj", options);
  ASSERT_TRUE(content.ok()) << content.status();
  EXPECT_THAT(content->mesh.labels, ElementsAre(-1, 1, 1, 1, 2, 1, -1));
  EXPECT_EQ(content->label_property, "usemtl");
  EXPECT_THAT(materials.names(), ElementsAre("of an earlier file", "old roof", "wall"));
  const StatusOr<MeshContent> without = ParseObj(text, "city.obj");
  ASSERT_TRUE(without.ok()) << without.status();
  EXPECT_THAT(without->mesh.labels, IsEmpty());
  EXPECT_EQ(without->label_property, "");
  EXPECT_EQ(without->mesh.faces, content->mesh.faces);
}

TEST(Obj, IsToldByItsContent) {
  const std::string path = testing::TempDir() + "/told.ply";
  std::ofstream(path, std::ios::binary) << "# made by hand\n\n" << kFourVertices << "f 1 2 3\nf 1 2 3 4\n";
  const StatusOr<MeshContent> content = ReadMesh(path);
  ASSERT_TRUE(content.ok()) << content.status();
  EXPECT_EQ(content->mesh.faces.size(), 3u);
  EXPECT_FALSE(*HasMoreFaces(path, 3));
  EXPECT_TRUE(*HasMoreFaces(path, 2));
  EXPECT_FALSE(HeadHasLabels("v 0 0 0\n"));
  EXPECT_TRUE(IsObj("mtllib a.mtl\n"));
  EXPECT_TRUE(IsObj("# only comments so far\n# and more"));
  EXPECT_FALSE(IsObj("newmtl red\n"));
  EXPECT_FALSE(IsObj(""));
  EXPECT_FALSE(IsObj("1 2 3\n"));
}

}  // namespace
}  // namespace tessera
