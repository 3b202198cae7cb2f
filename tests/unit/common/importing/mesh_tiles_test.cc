#include "common/importing/mesh_tiles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>

#include "common/importing/class_map.h"
#include "common/importing/rim_welder.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "tests/support/meshes/tile_folder.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

namespace fs = std::filesystem;

std::string TilesFolder() { return testing::TempDir() + "/mesh_tiles"; }
std::string MergedPath() {
  fs::create_directories(testing::TempDir() + "/mesh_tiles_out");
  return testing::TempDir() + "/mesh_tiles_out/mesh.ply";
}

struct Merged {
  MergedMesh counts;
  MeshContent content;
};

Merged MergeTiles(const std::string& folder, const MergeOptions& options = {}) {
  const StatusOr<MeshSource> source = FindMeshSource(folder);
  EXPECT_TRUE(source.ok()) << source.status();
  const StatusOr<MergedMesh> counts = MergeMeshes(*source, options, MergedPath(), nullptr);
  EXPECT_TRUE(counts.ok()) << counts.status();
  StatusOr<MeshContent> content = ReadPly(MergedPath());
  EXPECT_TRUE(content.ok()) << content.status();
  if (!counts.ok() || !content.ok()) return {};
  EXPECT_EQ(counts->vertices, static_cast<int64_t>(content->mesh.vertices.size()));
  EXPECT_EQ(counts->faces, static_cast<int64_t>(content->mesh.faces.size()));
  EXPECT_FALSE(content->float_positions);
  return {*counts, *std::move(content)};
}

std::string MergeError(const std::string& folder, const MergeOptions& options = {}) {
  const StatusOr<MergedMesh> counts = MergeMeshes(*FindMeshSource(folder), options, MergedPath(), nullptr);
  EXPECT_EQ(counts.status().code(), absl::StatusCode::kInvalidArgument) << counts.status();
  return std::string(counts.status().message());
}

int64_t OpenEdges(const TriangleMesh& mesh) {
  std::set<std::pair<uint32_t, uint32_t>> edges;
  for (const Triangle& face : mesh.faces) {
    for (size_t k = 0; k < 3; ++k) EXPECT_TRUE(edges.emplace(face[k], face[(k + 1) % 3]).second);
  }
  int64_t open = 0;
  for (const auto& [a, b] : edges) open += !edges.contains({b, a});
  return open;
}

TEST(MeshTiles, ClosesTheBordersBetweenTiles) {
  TileFolder tiles;
  tiles.tiles_x = 3;
  // Tiles differ by up to .9 mm, neighbours too.
  tiles.shift_x_m = [](int x, int y) { return 4.5e-4 * (x % 2 == 0 ? 1 : -1) + 1e-5 * y; };
  tiles.Write(TilesFolder());
  const Merged merged = MergeTiles(TilesFolder());
  EXPECT_EQ(merged.counts.vertices, tiles.Vertices());
  EXPECT_EQ(merged.counts.faces, tiles.Faces());
  EXPECT_EQ(merged.counts.welded_vertices, 6 * 25 - tiles.Vertices());
  EXPECT_EQ(merged.counts.collapsed_faces, 0);
  EXPECT_EQ(merged.counts.tile_faces, std::vector<int64_t>(6, tiles.FacesOfTile()));
  EXPECT_EQ(OpenEdges(merged.content.mesh), 2 * (3 * 4 + 2 * 4));
  ASSERT_EQ(merged.counts.tile_rects.size(), 6u);
  EXPECT_EQ(merged.counts.tile_rects[3], (PlanRect{1.99956, 2, 3.99956, 4}));  // in coordinates of the file
  EXPECT_THAT(merged.content.mesh.labels, IsEmpty());
  for (const Eigen::Vector3d& vertex : merged.content.mesh.vertices) {
    EXPECT_TRUE(merged.counts.bounds.contains(vertex));
    EXPECT_NEAR(vertex.z(), 500 + TileFolder::Height(vertex.x() - 691000.5, vertex.y() - 5334000.25), 1.5e-3);
  }
  EXPECT_LT((merged.counts.bounds.min() - Eigen::Vector3d(691000.5, 5334000.25, 528)).head<2>().norm(), 1e-3);
}

TEST(MeshTiles, LeavesBordersThatAreFurtherApart) {
  TileFolder tiles;
  tiles.shift_x_m = [](int x, int) { return 2e-3 * x; };
  tiles.Write(TilesFolder());
  const Merged merged = MergeTiles(TilesFolder());
  EXPECT_EQ(merged.counts.vertices, tiles.Vertices() + 2 * 4 + 1);  // two columns of vertices at the middle
  MergeOptions wide;
  wide.weld_m = 3e-3;
  EXPECT_EQ(MergeTiles(TilesFolder(), wide).counts.vertices, tiles.Vertices());
}

TEST(MeshTiles, ClosesTheBordersOfTriangleSoups) {
  TileFolder tiles;
  tiles.soup = true;
  tiles.Write(TilesFolder());
  const Merged merged = MergeTiles(TilesFolder());
  EXPECT_EQ(merged.counts.faces, tiles.Faces());
  std::set<std::tuple<double, double, double>> places;
  for (const Eigen::Vector3d& v : merged.content.mesh.vertices) places.emplace(v.x(), v.y(), v.z());
  EXPECT_EQ(static_cast<int64_t>(places.size()), tiles.Vertices());
}

TEST(MeshTiles, VerticesOfOneTileStayApart) {
  // The second tile has two vertices .2 mm apart at the border: both become the first tile's, and their face vanishes.
  fs::remove_all(TilesFolder());
  fs::create_directories(TilesFolder());
  std::ofstream(TilesFolder() + "/a.obj") << "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0.0002 1.0002 0\nf 1 2 3\nf 2 4 3\n";
  const Merged alone = MergeTiles(TilesFolder());
  EXPECT_EQ(alone.counts.vertices, 4);
  EXPECT_EQ(alone.counts.faces, 2);
  std::ofstream(TilesFolder() + "/b.obj") << "v 1 0 0\nv 2 0 0\nv 1.0002 0.0002 0\nf 1 2 3\nf 3 2 2\n";
  const Merged merged = MergeTiles(TilesFolder());
  EXPECT_EQ(merged.counts.vertices, 5);
  EXPECT_EQ(merged.counts.welded_vertices, 2);
  EXPECT_EQ(merged.counts.collapsed_faces, 1);
  EXPECT_THAT(merged.counts.tile_faces, ElementsAre(2, 1));  // the face that was degenerate before stays for the repair
}

TEST(MeshTiles, ConvertsCoordinatesWithTheOffset) {
  TileFolder().Write(TilesFolder());
  MergeOptions options;
  options.scene_from_source = [](const Eigen::Vector3d& p) {
    return Eigen::Vector3d(p.y() - 5334000.25, 691000.5 - p.x(), p.z() - 500);
  };
  const Merged merged = MergeTiles(TilesFolder(), options);
  EXPECT_EQ(merged.counts.vertices, TileFolder().Vertices());
  for (const Eigen::Vector3d& v : merged.content.mesh.vertices) {
    EXPECT_NEAR(v.z(), TileFolder::Height(-v.y(), v.x()), 2e-6);
  }
  options.scene_from_source = [](const Eigen::Vector3d& p) {
    return Eigen::Vector3d(p.x(), p.y(), p.x() > 691002 ? HUGE_VAL : 0);
  };
  EXPECT_THAT(MergeError(TilesFolder(), options),
              AllOf(HasSubstr("Tile_+000_+000.obj: vertex 4: found a position that has no coordinates in the scene's"),
                    HasSubstr("Tile_+001_+001.obj: vertex ")));
}

TEST(MeshTiles, MaterialsBecomeClasses) {
  TileFolder tiles;
  tiles.Write(TilesFolder());
  MergeOptions options;
  options.labels = LabelSource::kMaterial;
  options.classes = {"ground", "facade", "roof"};
  options.class_map = {{"Roof 1", "roof"}, {"Wall", "brick"}, {"unused", ""}};
  const Merged merged = MergeTiles(TilesFolder(), options);
  EXPECT_THAT(merged.counts.classes, ElementsAre("ground", "facade", "roof", "brick"));
  ASSERT_EQ(merged.counts.labels.size(), 2u);
  EXPECT_EQ(merged.counts.labels[0].name, "Roof 1");
  EXPECT_EQ(merged.counts.labels[0].faces, tiles.Faces() / 2);
  EXPECT_EQ(merged.counts.labels[0].label, 2);
  EXPECT_EQ(merged.counts.labels[1].label, 3);
  EXPECT_EQ(merged.counts.faces_without_class, 0);
  ASSERT_EQ(static_cast<int64_t>(merged.content.mesh.labels.size()), tiles.Faces());
  for (size_t f = 0; f < merged.content.mesh.labels.size(); ++f) {
    EXPECT_EQ(merged.content.mesh.labels[f], f % 32 < 16 ? 2 : 3) << f;
  }
  options.class_map = {{"Roof 1", "roof"}, {"Wall", ""}};
  const Merged part = MergeTiles(TilesFolder(), options);
  EXPECT_EQ(part.counts.faces_without_class, tiles.Faces() / 2);
  EXPECT_EQ(part.content.mesh.labels[31], -1);
  options.class_map = {};
  options.classes = {"Wall"};
  EXPECT_EQ(MergeError(TilesFolder(), options),
            "mesh: materials: found 1 names without a class, expected each of them in the file of --classes, with a "
            "class or null: {\"Roof 1\": \"CLASS\"}; classes of the scene: Wall");
}

TEST(MeshTiles, APropertyBecomesTheLabels) {
  fs::remove_all(TilesFolder());
  fs::create_directories(TilesFolder());
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.faces = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}};
  mesh.labels = {6, 2, -1};
  ASSERT_TRUE(WritePly(TilesFolder() + "/a.ply", mesh).ok());
  MergeOptions options;
  options.labels = LabelSource::kProperty;
  options.label_property = "label";
  options.classes = {"ground", "roof"};
  EXPECT_THAT(MergeTiles(TilesFolder(), options).content.mesh.labels, ElementsAre(6, 2, -1));
  options.class_map = {{"6", "roof"}, {"2", "ground"}};
  const Merged merged = MergeTiles(TilesFolder(), options);
  EXPECT_THAT(merged.content.mesh.labels, ElementsAre(1, 0, -1));
  EXPECT_EQ(merged.counts.faces_without_class, 1);
  options.class_map = {{"6", "roof"}};
  EXPECT_THAT(MergeError(TilesFolder(), options), HasSubstr("labels: found 1 names without a class"));
  EXPECT_THAT(MergeTiles(TilesFolder()).content.mesh.labels, IsEmpty());
  options.label_property = "class";
  EXPECT_THAT(MergeError(TilesFolder(), options), HasSubstr("a.ply: header: found no property 'class'"));
  options.labels = LabelSource::kMaterial;
  EXPECT_THAT(MergeError(TilesFolder(), options), HasSubstr("a.ply: found a PLY file, which has no materials"));
}

TEST(MeshTiles, NamesTheFaultsOfAllTiles) {
  TileFolder().Write(TilesFolder());
  std::ofstream(TilesFolder() + "/Data/Tile_+000_+001/Tile_+000_+001.obj") << "v 0 0 0\nf 1 2 3\n";
  std::ofstream(TilesFolder() + "/Data/Tile_+001_+001/Tile_+001_+001.obj") << "v 0 nan 0\n";
  EXPECT_THAT(MergeError(TilesFolder()), AllOf(HasSubstr("Tile_+000_+001.obj: line 2: found vertex index 3"),
                                               HasSubstr("Tile_+001_+001.obj: line 1: found coordinate 'nan'")));
}

TEST(MeshTiles, LeavesNothingBehindWhenItFails) {
  TileFolder().Write(TilesFolder());
  fs::remove(MergedPath());
  MergeOptions options;
  int checks = 0;
  options.control.cancelled = [&checks] { return ++checks > 3; };
  EXPECT_EQ(MergeMeshes(*FindMeshSource(TilesFolder()), options, MergedPath(), nullptr).status().code(),
            absl::StatusCode::kCancelled);
  EXPECT_THAT(*ListFiles(fs::path(MergedPath()).parent_path().string()), IsEmpty());
}

// The limit on the size of files stands for a full disk.
TEST(MeshTiles, SaysThatTheDiskIsFull) {
  TileFolder().Write(TilesFolder());
  fs::remove(MergedPath());
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small = {1000, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &small);
  const StatusOr<MergedMesh> merged = MergeMeshes(*FindMeshSource(TilesFolder()), {}, MergedPath(), nullptr);
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  EXPECT_TRUE(IsFileError(merged.status())) << merged.status();
  EXPECT_THAT(std::string(merged.status().message()), HasSubstr("mesh_tiles_out"));
  EXPECT_THAT(*ListFiles(fs::path(MergedPath()).parent_path().string()), IsEmpty());
}

TEST(RimWelder, RimsAreEdgesWithOneFace) {
  TriangleMesh mesh;  // a pyramid without its base, of two vertices at its top
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {.5, .5, 1}, {.5, .5, 1}, {9, 9, 9}};
  mesh.faces = {{0, 1, 4}, {1, 2, 5}, {2, 3, 4}, {3, 0, 5}};
  EXPECT_EQ(RimVertices(mesh), (std::vector<bool>{true, true, true, true, false, false, false}));
  mesh.faces.push_back({0, 2, 1});
  mesh.faces.push_back({0, 3, 2});
  EXPECT_EQ(RimVertices(mesh), std::vector<bool>(7, false));
}

TEST(RimWelder, FindsTheClosestWithinTheDistance) {
  RimWelder welder(1e-3);
  const Eigen::Vector3d at(691000.25, -5334000.5, 12);
  EXPECT_EQ(welder.Find(at), RimWelder::kNone);
  welder.Add(at, 7);
  welder.Add(at + Eigen::Vector3d(6e-4, 0, 0), 8);
  welder.Add(at, 5);
  EXPECT_EQ(welder.Find(at), 5u);
  EXPECT_EQ(welder.Find(at + Eigen::Vector3d(5e-4, 0, 0)), 8u);
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      const Eigen::Vector3d step = sign * Eigen::Vector3d::Unit(axis);
      EXPECT_NE(welder.Find(at + 0.9e-3 * step), RimWelder::kNone);
      EXPECT_EQ(welder.Find(at + 1.7e-3 * step), RimWelder::kNone);
    }
  }
}

TEST(ClassMap, IsAnObjectOfNames) {
  const StatusOr<ClassMap> map = ParseClassMap("{\"Roof 1\": \"roof\", \"Trees\": null}", "classes.json");
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_EQ(*map, (ClassMap{{"Roof 1", "roof"}, {"Trees", ""}}));
  const auto error = [](const std::string& text) {
    return std::string(ParseClassMap(text, "classes.json").status().message());
  };
  EXPECT_THAT(error("{\"a\": 3, \"b\": \"\"}"),
              AllOf(HasSubstr("classes.json: key \"a\": found a value that is no name"), HasSubstr("key \"b\"")));
  EXPECT_THAT(error("[]"), HasSubstr("found no object, expected a JSON object such as"));
  EXPECT_THAT(error("{\"a\" 3}"), HasSubstr("classes.json: byte 6: found damaged JSON"));
  EXPECT_THAT(error("{\"a\": 1e999}"), HasSubstr("found damaged JSON"));
  EXPECT_EQ(ReadClassMap("/nowhere/classes.json").status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace tessera
