// Passes over meshes on disk give the same results as in memory, for any part size.
#include "worker/city/disk_mesh.h"

#include <gtest/gtest.h>

#include <cstring>
#include <set>

#include "common/base/random.h"
#include "common/geometry/coarse_mesh.h"
#include "common/geometry/repair.h"
#include "tests/support/bent_meshes.h"
#include "tests/support/quad_mesh.h"
#include "tests/support/tiny_scene.h"
#include "tests/unit/worker/city/to_disk.h"
#include "worker/city/local_grid.h"

namespace tessera {
namespace {

template <class T>
std::vector<T> Values(const ScratchArray<T>& array) {
  return {array.values().begin(), array.values().end()};
}

void ExpectSame(const TriangleMesh& expected, const DiskMesh& found) {
  ASSERT_EQ(found.vertices.size(), expected.vertices.size());
  EXPECT_EQ(std::memcmp(expected.vertices.data(), found.vertices.values().data(),
                        expected.vertices.size() * sizeof(Eigen::Vector3d)),
            0);
  EXPECT_EQ(Values(found.faces), expected.faces);
  EXPECT_EQ(Values(found.labels), expected.labels);
}

// Few vertices and many faces, so that every kind of defect occurs.
TriangleMesh Mess(uint64_t seed) {
  Random random(seed);
  TriangleMesh mesh;
  for (int v = 0; v < 40; ++v)
    mesh.vertices.push_back({double(random.Below(6)), double(random.Below(6)), double(v % 3)});
  const int faces = 10 + static_cast<int>(random.Below(60));
  for (int f = 0; f < faces; ++f) {
    Triangle face;
    for (uint32_t& v : face) v = static_cast<uint32_t>(random.Below(36));
    if (f > 0 && random.Below(8) == 0) face = {mesh.faces[f - 1][1], mesh.faces[f - 1][0], mesh.faces[f - 1][2]};
    if (f > 0 && random.Below(3) == 0) face = {mesh.faces[f - 1][1], mesh.faces[f - 1][0], face[2]};
    mesh.faces.push_back(face);
    mesh.labels.push_back(static_cast<int32_t>(random.Below(4)) - 1);
  }
  return mesh;
}

void ExpectSame(const DefectCount& a, const DefectCount& b) {
  EXPECT_EQ(a.count, b.count);
  EXPECT_EQ(a.first, b.first);
}

// Defects that RepairMesh finds on disk and in memory, for parts of several sizes. Returns those in memory.
RepairedMesh ExpectSameRepair(const TriangleMesh& mesh, const RepairOptions& options) {
  const auto expected = RepairMesh(mesh, options, nullptr);
  EXPECT_TRUE(expected.ok()) << expected.status();
  if (!expected.ok()) return {};
  for (const size_t size : {1, 3, 7, 1000}) {
    MeshDefects defects;
    const auto found = RepairOnDisk(ToDisk(mesh), testing::TempDir(), {.vertices_per_part = size}, options, &defects);
    EXPECT_TRUE(found.ok()) << found.status();
    if (!found.ok()) continue;
    ExpectSame(expected->mesh, *found);
    if (found->input_face.size() > 0 || expected->face_in_input.empty()) {
      const std::vector<uint32_t> input_face = Values(found->input_face);
      EXPECT_EQ(std::vector<int64_t>(input_face.begin(), input_face.end()), expected->face_in_input);
    } else {
      EXPECT_TRUE(expected->removed_faces.empty());
    }
    const MeshDefects& d = expected->defects;
    ExpectSame(defects.repeated_vertex_faces, d.repeated_vertex_faces);
    ExpectSame(defects.zero_area_faces, d.zero_area_faces);
    ExpectSame(defects.duplicate_faces, d.duplicate_faces);
    ExpectSame(defects.non_manifold_edges, d.non_manifold_edges);
    ExpectSame(defects.conflicting_edges, d.conflicting_edges);
    ExpectSame(defects.non_manifold_vertices, d.non_manifold_vertices);
    ExpectSame(defects.unreferenced_vertices, d.unreferenced_vertices);
    ExpectSame(defects.stray_vertices, d.stray_vertices);
    EXPECT_EQ(defects.stray_faces, d.stray_faces);
    ExpectSame(defects.welded_vertices, d.welded_vertices);
    ExpectSame(defects.turned_faces, d.turned_faces);
    ExpectSame(defects.small_pieces, d.small_pieces);
    EXPECT_EQ(defects.boundary_edges, d.boundary_edges);
  }
  return *expected;
}

TEST(RepairOnDisk, EqualsRepairMeshForAnyPartSize) {
  int64_t copies = 0, removed = 0, welded = 0, turned = 0;
  for (uint64_t seed = 0; seed < 60; ++seed) {
    SCOPED_TRACE(seed);
    const TriangleMesh mesh = Mess(seed);
    const RepairedMesh out = ExpectSameRepair(mesh, seed % 4 == 0 ? ViewsAround(mesh) : RepairOptions());
    copies += out.vertex_copies;
    removed += static_cast<int64_t>(out.removed_faces.size());
    welded += out.defects.welded_vertices.count;
    turned += out.defects.turned_faces.count;
  }
  EXPECT_GT(copies, 0);
  EXPECT_GT(removed, 0);
  EXPECT_GT(welded, 0);
  EXPECT_GT(turned, 0);
}

TEST(RepairOnDisk, EqualsRepairMeshForSoupsTilesMixedOrientationsAndStrayVertices) {
  for (uint64_t seed = 0; seed < 12; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    TriangleMesh mesh = MakeTinyScene().mesh;
    RepairOptions options = ViewsAround(mesh);
    options.scratch_folder = testing::TempDir();
    options.max_faces_for_rays = seed < 6 ? 4 << 20 : 100;
    const bool some = seed % 2 == 0;
    for (Triangle& face : mesh.faces) {
      if (!some || random.Below(4) == 0) std::swap(face[1], face[2]);
    }
    if (seed % 3 == 0) mesh = Soup(mesh);
    if (seed % 3 == 1) mesh = Tiles(mesh, 3);
    const auto stray = static_cast<size_t>(random.Below(static_cast<int64_t>(mesh.vertices.size())));
    mesh.vertices[stray] = {-386512, -6671850, -20};
    for (Eigen::Vector3d& p : mesh.vertices) p.z() += 1e-7 * static_cast<double>(random.Below(3));
    const RepairedMesh out = ExpectSameRepair(mesh, options);
    EXPECT_GT(out.defects.turned_faces.count, 0);
    EXPECT_GT(out.defects.stray_vertices.count, 0);
    EXPECT_EQ(out.defects.welded_vertices.count > 0, seed % 3 != 2);
  }
}

TEST(SplitOnDisk, EqualsSplitLargeFacesForAnyChunkSize) {
  const TinyScene scene = MakeTinyScene();
  TriangleMesh mesh = scene.mesh;
  // Also with an order of faces without locality.
  Random random(1);
  TriangleMesh shuffled = mesh;
  for (size_t f = shuffled.faces.size(); f > 1; --f) {
    const auto other = static_cast<size_t>(random.Below(static_cast<int64_t>(f)));
    std::swap(shuffled.faces[f - 1], shuffled.faces[other]);
    std::swap(shuffled.labels[f - 1], shuffled.labels[other]);
  }
  for (const TriangleMesh& input : {mesh, shuffled}) {
    const DensityOptions density = {.max_footprint_px2 = 8, .max_rounds = 8};
    const SplitMesh expected = SplitLargeFaces(input, scene.cameras, density);
    EXPECT_GT(expected.round_ends.size(), 1u);
    std::vector<Eigen::Vector3d> starts;  // a vertex between two starts between theirs
    for (const Eigen::Vector3d& p : input.vertices) starts.emplace_back(p.y(), -p.x(), p.z() + p.x() * p.y());
    const std::vector<Eigen::Vector3d> given = starts;
    for (const auto& [a, b] : expected.halved_edges) starts.emplace_back(0.5 * (starts[a] + starts[b]));
    for (const size_t faces : {1, 50, 100000}) {
      for (const double split_faces : {1.0, 200.0, 1e9}) {
        DiskMesh on_disk = ToDisk(input);
        on_disk.starts = *ScratchArray<Eigen::Vector3d>::Create(testing::TempDir(), given.size());
        std::copy(given.begin(), given.end(), on_disk.starts.values().begin());
        const auto found = SplitOnDisk(std::move(on_disk), scene.cameras, density, testing::TempDir(),
                                       {.faces_per_chunk = faces, .split_faces_per_chunk = split_faces},
                                       [](double) { return absl::OkStatus(); });
        ASSERT_TRUE(found.ok()) << found.status();
        ExpectSame(expected.mesh, *found);
        EXPECT_EQ(Values(found->starts), starts);
        EXPECT_EQ(Values(found->input_face), expected.parent_face);
      }
    }
  }
}

TEST(ReadMeshToDisk, EqualsLoadSceneMeshOnTheLocalGrid) {
  const std::string folder = FreshTestFolder("to_disk");
  TinySceneOptions options;
  options.offset = {357000.25, 5788000.1, 40};
  WriteTinyScene(folder, options);
  Warnings warnings;
  const auto scene = LoadScene(folder, &warnings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  auto expected = LoadSceneMesh(*scene, 0);
  ASSERT_TRUE(expected.ok());
  for (Eigen::Vector3d& p : expected->vertices) p = OnLocalGrid(p);
  const auto found = ReadMeshToDisk(*scene, folder);
  ASSERT_TRUE(found.ok()) << found.status();
  ExpectSame(*expected, *found);
  SceneDescription fewer = *scene;
  fewer.classes.resize(2);
  EXPECT_EQ(ReadMeshToDisk(fewer, folder).status().message(), LoadSceneMesh(fewer, 0).status().message());
  WriteText(folder + "/mesh.ply", ReadText(folder + "/mesh.ply").substr(0, 3000));
  EXPECT_EQ(ReadMeshToDisk(*scene, folder).status().message(), LoadSceneMesh(*scene, 0).status().message());
}

TEST(ReadMeshToDisk, EqualsLoadSceneMeshForMeshesOfOtherPrograms) {
  const std::string folder = FreshTestFolder("other");
  const TinyScene tiny = WriteTinyScene(folder);
  const std::string mark = "\xef\xbb\xbf";
  for (const std::string& bytes : {QuadPly(tiny.mesh), QuadObj(tiny.mesh), VertexLabelPly(tiny.mesh),
                                   mark + QuadPly(tiny.mesh) + std::string(5, '\0')}) {
    WriteText(folder + "/mesh.ply", bytes);
    Warnings of_scene, of_disk;
    const auto scene = LoadScene(folder, &of_scene);
    ASSERT_TRUE(scene.ok()) << scene.status();
    of_scene.clear();
    auto expected = LoadSceneMesh(*scene, 0, &of_scene);
    ASSERT_TRUE(expected.ok()) << expected.status();
    for (Eigen::Vector3d& p : expected->vertices) p = OnLocalGrid(p);
    const auto found = ReadMeshToDisk(*scene, folder, &of_disk);
    ASSERT_TRUE(found.ok()) << found.status();
    ExpectSame(*expected, *found);
    EXPECT_EQ(found->faces.size(), tiny.mesh.faces.size());
    EXPECT_EQ(of_disk, of_scene);
    EXPECT_FALSE(of_disk.empty());
    // Errors are the same too.
    WriteText(folder + "/mesh.ply", bytes + "f 1 2\n" + std::string(20, '7'));
    EXPECT_FALSE(ReadMeshToDisk(*scene, folder).ok());
    EXPECT_EQ(ReadMeshToDisk(*scene, folder).status().message(), LoadSceneMesh(*scene, 0).status().message());
  }
}

TEST(CoarsenMesh, StaysWithinItsErrorBoundAndHasNoDuplicateFaces) {
  const TinyScene scene = MakeTinyScene();
  const SplitMesh fine = SplitLargeFaces(scene.mesh, scene.cameras, {.max_footprint_px2 = 1, .max_rounds = 8});
  const auto coarse = CoarsenMesh(fine.mesh, 400, testing::TempDir());
  ASSERT_TRUE(coarse.ok()) << coarse.status();
  EXPECT_LT(coarse->mesh.faces.size(), fine.mesh.faces.size() / 8);
  EXPECT_GT(coarse->mesh.faces.size(), 200u);
  for (const Eigen::Vector3d& p : coarse->mesh.vertices) {
    double nearest = 1e9;
    for (const Eigen::Vector3d& q : fine.mesh.vertices) nearest = std::min(nearest, (p - q).norm());
    EXPECT_LE(nearest, coarse->error_m);
  }
  std::set<Triangle> faces(coarse->mesh.faces.begin(), coarse->mesh.faces.end());
  EXPECT_EQ(faces.size(), coarse->mesh.faces.size());
}

}  // namespace
}  // namespace tessera
