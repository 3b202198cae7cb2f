// Files of other kinds in place of a mesh: the message says what they are and what to do.
#include "common/meshio/foreign_content.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>

#include "common/meshio/mesh_format.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::HasSubstr;

std::string ReadAsMesh(const std::string& bytes) {
  const std::string path = testing::TempDir() + "/foreign.ply";
  std::ofstream(path, std::ios::binary) << bytes;
  const StatusOr<MeshContent> content = ReadMesh(path);
  EXPECT_EQ(content.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(HasMoreFaces(path, 10).status().message(), content.status().message());
  return std::string(content.status().message());
}

std::string BinaryStl(uint32_t triangles) {
  std::string bytes = "solid" + std::string(75, ' ');
  for (int k = 0; k < 4; ++k) bytes += static_cast<char>((triangles >> (8 * k)) & 255);
  return bytes + std::string(50 * triangles, '\0');
}

TEST(ForeignContent, IsNamed) {
  EXPECT_THAT(ReadAsMesh("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345678\n"),
              AllOf(HasSubstr("foreign.ply: first bytes: found a Git LFS pointer in place of the file, expected a mesh "
                              "file (PLY, OBJ, glTF): run 'git lfs pull'")));
  EXPECT_THAT(ReadAsMesh("solid cube\nfacet normal 0 0 1\n outer loop\n"),
              AllOf(HasSubstr("found a text STL file"), HasSubstr("(PLY, OBJ, glTF): convert it")));
  EXPECT_THAT(ReadAsMesh(BinaryStl(3)), HasSubstr("found a binary STL file"));
  EXPECT_THAT(ReadAsMesh("b3dm\x01"),
              AllOf(HasSubstr("found a tile of 3D Tiles (B3DM)"), HasSubstr("export the mesh")));
  EXPECT_THAT(ReadAsMesh("3MXBO"), HasSubstr("found a tile of 3MX"));
  EXPECT_THAT(ReadAsMesh("\xa1\x0e\x91\x6c\x45\x45\xfb\x1a\x01"), HasSubstr("found an OSGB file"));
  EXPECT_THAT(ReadAsMesh("<?xml version=\"1.0\"?>\n<COLLADA>"), HasSubstr("found a COLLADA file (DAE)"));
  for (const char* const off : {"OFF\n3 1 0\n", "COFF 3 1 0\n"}) {
    EXPECT_THAT(ReadAsMesh(off), HasSubstr("found an OFF file"));
  }
  EXPECT_THAT(ReadAsMesh("LASF\x01"), AllOf(HasSubstr("found a point cloud (LAS or LAZ)"), HasSubstr("build a mesh")));
  EXPECT_THAT(ReadAsMesh("# .PCD v0.7\nVERSION 0.7\n"), HasSubstr("found a point cloud (PCD)"));
  EXPECT_THAT(ReadAsMesh("PK\x03\x04"), AllOf(HasSubstr("found a ZIP archive"), HasSubstr("unpack it")));
  EXPECT_THAT(ReadAsMesh("<!DOCTYPE html><html>"), HasSubstr("found a web page"));
  EXPECT_THAT(ReadAsMesh(""), HasSubstr("found an empty file, expected a mesh file (PLY, OBJ, glTF)"));
  EXPECT_THAT(ReadAsMesh("1 2 3\n"), HasSubstr("found no known mesh format"));
}

}  // namespace
}  // namespace tessera
