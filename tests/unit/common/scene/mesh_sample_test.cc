// Samples of start meshes: a few faces, without reading the file.
#include "common/scene/mesh_sample.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <set>
#include <string>

#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::HasSubstr;

// A strip of `faces` triangles, each with a place of its own.
TriangleMesh Strip(int faces) {
  TriangleMesh mesh;
  for (int i = 0; i < faces + 2; ++i) mesh.vertices.emplace_back(i, i % 2, 0.25 * (i % 7));
  for (uint32_t f = 0; f < static_cast<uint32_t>(faces); ++f) mesh.faces.push_back({f, f + 1, f + 2});
  mesh.labels.assign(faces, 1);
  return mesh;
}

class MeshSampleTest : public testing::Test {
 protected:
  MeshSampleTest() {
    scene_.folder = FreshTestFolder("mesh_sample");
    scene_.mesh_path = "mesh.ply";
  }
  std::string Path() const { return scene_.folder + "/" + scene_.mesh_path; }
  StatusOr<MeshSample> Sample() const { return SampleSceneMesh(scene_, AllowedFiles::All()); }

  SceneDescription scene_;
};

TEST_F(MeshSampleTest, ASmallMeshIsSampledWhole) {
  const TriangleMesh mesh = Strip(50);
  ASSERT_TRUE(WritePly(Path(), mesh).ok());
  const auto sample = Sample();
  ASSERT_TRUE(sample.ok()) << sample.status();
  EXPECT_EQ(sample->faces, 50);
  ASSERT_EQ(sample->mesh.faces.size(), 50u);
  for (size_t f = 0; f < 50; ++f) {
    for (int k = 0; k < 3; ++k) EXPECT_EQ(sample->mesh.Corner(f, k), mesh.Corner(f, k));
  }
}

TEST_F(MeshSampleTest, ALargeMeshIsSampledEvenly) {
  const int faces = 200'000;
  ASSERT_TRUE(WritePly(Path(), Strip(faces)).ok());
  const auto sample = Sample();
  ASSERT_TRUE(sample.ok()) << sample.status();
  EXPECT_EQ(sample->faces, faces);
  EXPECT_EQ(sample->mesh.faces.size(), static_cast<size_t>(kSampledFaces));
  std::set<int> tenths;
  for (size_t f = 0; f < sample->mesh.faces.size(); ++f) {
    const double x = sample->mesh.Corner(f, 0).x();
    EXPECT_EQ(sample->mesh.Corner(f, 1).x(), x + 1);
    tenths.insert(static_cast<int>(10 * x / faces));
  }
  EXPECT_EQ(tenths.size(), 10u);
}

TEST_F(MeshSampleTest, TextHasACountButNoSample) {
  WriteText(Path(), AsciiPly(Strip(5), "float"));
  const auto sample = Sample();
  ASSERT_TRUE(sample.ok()) << sample.status();
  EXPECT_EQ(sample->faces, 5);
  EXPECT_TRUE(sample->mesh.faces.empty());
}

TEST_F(MeshSampleTest, OtherFormatsHaveNeither) {
  WriteText(Path(), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  const auto sample = Sample();
  ASSERT_TRUE(sample.ok()) << sample.status();
  EXPECT_EQ(sample->faces, -1);
  EXPECT_TRUE(sample->mesh.faces.empty());
}

TEST_F(MeshSampleTest, DamageIsReportedWithItsPlace) {
  ASSERT_TRUE(WritePly(Path(), Strip(50)).ok());
  std::string bytes = ReadText(Path());
  const std::string whole = bytes;
  // The last face is "uchar 3, int x 3, int label".
  bytes[bytes.size() - 5] = 0x7f;
  WriteText(Path(), bytes);
  EXPECT_THAT(std::string(Sample().status().message()), HasSubstr("face 49: found vertex 21"));
  WriteText(Path(), whole.substr(0, whole.size() - 100));
  EXPECT_FALSE(Sample().ok());
  std::filesystem::remove(Path());
  EXPECT_EQ(Sample().status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace tessera
