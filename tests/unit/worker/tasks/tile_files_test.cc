#include "worker/tasks/tile_files.h"

#include <gtest/gtest.h>

#include "common/storage/files.h"
#include "worker/tasks/task.h"

namespace tessera {
namespace {

std::string TestPath(const std::string& name) {
  std::string path = testing::TempDir();
  path += '/';
  path += name;
  return path;
}

TriangleMesh OneFace() {
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1.0 / 3, 0, 0}, {0, 1e-300, 0}};
  mesh.faces = {{0, 1, 2}};
  mesh.labels = {-1};
  return mesh;
}

TEST(TileFiles, PackageRoundTrip) {
  TilePackage p;
  p.tile = 5;
  p.gsd_m = 0.1;
  p.view_depths = {{3.5, 60}, {0.1, 1.0 / 3}};
  p.cell_views = {{0}, {}};
  p.cell = {1};
  p.classes.resize(2);
  p.views.resize(2);
  p.views[1].name = std::string("second");
  p.pairs = {{0, 1}, {1, 0}};
  p.has_likelihoods = true;
  p.mesh = OneFace();
  p.vertex_ids = {4, 5, 9};
  p.face_ids = {7};
  p.fixed = {0, 1, 0};
  p.core = {1};
  ASSERT_TRUE(WriteTilePackage(TestPath("package.arrays"), p).ok());
  const auto read = ReadTilePackage(TestPath("package.arrays"));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->tile, 5);
  EXPECT_EQ(read->view_depths, p.view_depths);
  EXPECT_EQ(read->cell_views, p.cell_views);
  EXPECT_EQ(read->cell, p.cell);
  EXPECT_EQ(read->views[1].name, "second");
  EXPECT_EQ(read->pairs, p.pairs);
  EXPECT_EQ(read->mesh.vertices, p.mesh.vertices);
  EXPECT_EQ(read->mesh.faces, p.mesh.faces);
  EXPECT_EQ(read->vertex_ids, p.vertex_ids);
  EXPECT_EQ(read->fixed, p.fixed);
}

TEST(RunTask, UnknownKindAndWrongParametersAreTheInputsFault) {
  const TaskRequest unknown = {"dance", "{}", testing::TempDir(), testing::TempDir()};
  EXPECT_EQ(RunTask(unknown, {}).status().code(), absl::StatusCode::kInvalidArgument);
  for (const char* kind : {"cut", "refine", "stitch", "publish"}) {
    const TaskRequest request = {kind, "{\"surprise\":1}", testing::TempDir(), testing::TempDir()};
    EXPECT_EQ(RunTask(request, {}).status().code(), absl::StatusCode::kInvalidArgument) << kind;
  }
}

}  // namespace
}  // namespace tessera
