#include "worker/tile/tile_files.h"

#include <gtest/gtest.h>

#include <cmath>

#include "common/storage/files.h"
#include "tests/support/read_tile_state.h"
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

// Damages single bytes of the file and truncates it; expects DATA_LOSS from `read`.
template <class Read>
void ExpectDamageFound(const std::string& path, const Read& read) {
  const std::string bytes = *ReadFile(path);
  ASSERT_TRUE(read(path).ok());
  for (const size_t place : {size_t{3}, bytes.size() / 2, bytes.size() - 1}) {
    std::string damaged = bytes;
    damaged[place] ^= 4;
    ASSERT_TRUE(WriteFileAtomic(path + ".damaged", damaged).ok());
    EXPECT_EQ(read(path + ".damaged").status().code(), absl::StatusCode::kDataLoss) << "byte " << place;
  }
  ASSERT_TRUE(WriteFileAtomic(path + ".damaged", bytes.substr(0, bytes.size() - 5)).ok());
  EXPECT_EQ(read(path + ".damaged").status().code(), absl::StatusCode::kDataLoss);
}

TilePackage OnePackage() {
  TilePackage p;
  p.tile = 5;
  p.ground = MakeGroundPlane(Eigen::Vector3d(1, 2, 3).normalized(), 1.0 / 3);
  p.gsd_m = 0.1;
  p.up = Eigen::Vector3d(1, 2, 3).normalized();
  p.classes.resize(2);
  p.has_likelihoods = p.has_labels = p.has_pairs = true;
  p.borders = BorderTrusts(2);
  p.borders.Set(0, 1, {-1.0 / 3, 0.7, 0.9});
  p.views.resize(2);
  p.views[1].name = std::string("second");
  p.view_ids = {3, 8};
  p.view_rects = {{0, 4, 8, 12}, {}};
  p.pairs = {{0, 1}, {1, 0}};
  p.view_depths = {{3.5, 60}, {0.1, 1.0 / 3}};
  p.cell_at = {{-2, -1}, {4, 7}};
  p.cell_views = {{0}, {0, 1}};
  p.cells.face_begin = {0, 0, 1};
  p.cells.vertex_begin = {0, 2, 3};
  p.mesh = OneFace();
  FindVertexCells(p.mesh.faces, &p.cells);
  p.vertex_ids = {4, 5, 9};
  p.face_ids = {7};
  p.regions = {kCoreRegion | kLabelRegion};
  p.cut_regions = {0, kSolveRegion, kRepairRegion};
  return p;
}

TEST(TileFiles, PackageRoundTrip) {
  const TilePackage p = OnePackage();
  const std::string path = TestPath("package.arrays");
  ASSERT_TRUE(WriteTilePackage(path, p).ok());
  const auto read = ReadTilePackage(path);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->tile, 5);
  EXPECT_EQ(read->ground.axis_x, p.ground.axis_x);
  EXPECT_EQ(read->ground.axis_y, p.ground.axis_y);
  EXPECT_EQ(read->ground.cell_m, p.ground.cell_m);
  EXPECT_EQ(read->gsd_m, p.gsd_m);
  EXPECT_EQ(read->up, p.up);
  EXPECT_EQ(read->classes.size(), 2u);
  EXPECT_TRUE(read->has_likelihoods && read->has_labels && read->has_pairs);
  EXPECT_EQ(read->borders, p.borders);
  EXPECT_EQ(read->views[1].name, "second");
  EXPECT_EQ(read->view_ids, p.view_ids);
  EXPECT_EQ(read->view_rects, p.view_rects);
  EXPECT_EQ(read->view_depths, p.view_depths);
  EXPECT_EQ(read->pairs, p.pairs);
  EXPECT_EQ(read->cell_at, p.cell_at);
  EXPECT_EQ(read->cell_views, p.cell_views);
  EXPECT_EQ(read->cells.face_begin, p.cells.face_begin);
  EXPECT_EQ(read->cells.vertex_begin, p.cells.vertex_begin);
  EXPECT_EQ(read->cells.vertex_cells, p.cells.vertex_cells);
  EXPECT_EQ(read->mesh.vertices, p.mesh.vertices);
  EXPECT_EQ(read->mesh.faces, p.mesh.faces);
  EXPECT_EQ(read->mesh.labels, p.mesh.labels);
  EXPECT_EQ(read->vertex_ids, p.vertex_ids);
  EXPECT_EQ(read->face_ids, p.face_ids);
  EXPECT_EQ(read->regions, p.regions);
  EXPECT_EQ(read->cut_regions, p.cut_regions);
  ExpectDamageFound(path, ReadTilePackage);
}

TEST(TileFiles, InconsistentPackagesAreRejected) {
  const std::string path = TestPath("misfit.arrays");
  const auto code = [&](const TilePackage& p) {
    EXPECT_TRUE(WriteTilePackage(path, p).ok());
    return ReadTilePackage(path).status().code();
  };
  TilePackage p = OnePackage();
  p.view_ids.pop_back();
  EXPECT_EQ(code(p), absl::StatusCode::kDataLoss);
  p = OnePackage();
  p.cells.face_begin = {0, 2, 1};
  EXPECT_EQ(code(p), absl::StatusCode::kDataLoss);
  for (const int32_t view : {-1, 2}) {
    p = OnePackage();
    p.cell_views[1].push_back(view);
    EXPECT_EQ(code(p), absl::StatusCode::kDataLoss) << view;
    EXPECT_EQ(ReadTilePackage(path).status().message(),
              path + ": cell_views: found view " + std::to_string(view) + ", expected at least 0 and less than 2");
  }
  p = OnePackage();
  p.regions.clear();
  EXPECT_FALSE(code(p) == absl::StatusCode::kOk);
}

TEST(TileFiles, SumsRoundTrip) {
  TileSums s;
  s.tile = 3;
  s.face_ids = {2, 9};
  s.photo.resize(2);
  s.photo[1].gradient = {1.0f / 3, -2, 1e-30f};
  s.photo[1].curvature = {4, 5, 6};
  s.photo[1].pairs = 2.5f;
  s.contours.faces.resize(1);
  s.contours.faces[0].face = 1;
  for (int k = 0; k < 3; ++k) {
    s.contours.faces[0].gradient[k] = Eigen::Vector3d(k, 0.1f, -0.2f);
    for (int i = 0; i < 6; ++i) s.contours.faces[0].curvature[k][i] = static_cast<float>(10 * k + i) / 3;
  }
  s.contours.faces[0].views_begin = 0;
  s.contours.faces[0].views_end = 2;
  s.contours.views = {4, 8};
  s.energy = 1.0 / 3;
  const std::string path = TestPath("sums.arrays");
  ASSERT_TRUE(WriteTileSums(path, s).ok());
  auto read = ReadTileSums(path);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->tile, 3);
  EXPECT_EQ(read->face_ids, s.face_ids);
  ASSERT_EQ(read->photo.size(), 2u);
  EXPECT_EQ(read->photo[1].gradient, s.photo[1].gradient);
  EXPECT_EQ(read->photo[1].curvature, s.photo[1].curvature);
  EXPECT_EQ(read->photo[1].pairs, s.photo[1].pairs);
  ASSERT_EQ(read->contours.faces.size(), 1u);
  const FaceContour &contour = read->contours.faces[0], &expected = s.contours.faces[0];
  EXPECT_EQ(contour.face, 1u);
  EXPECT_EQ(contour.views_begin, 0u);
  EXPECT_EQ(contour.views_end, 2u);
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(contour.gradient[k], expected.gradient[k]);
    EXPECT_EQ(contour.curvature[k], expected.curvature[k]);
  }
  EXPECT_EQ(read->contours.views, s.contours.views);
  EXPECT_EQ(read->energy, s.energy);
  EXPECT_EQ(read->semantic_energy, -1);
  EXPECT_TRUE(read->pixels.empty());
  ExpectDamageFound(path, ReadTileSums);

  TileSums labels;
  labels.face_ids = {2, 9};
  labels.classes = 3;
  labels.likelihoods = {1, 2, 3, 4, 5, 0.1f};
  labels.pixels = {7, 0};
  ASSERT_TRUE(WriteTileSums(path, labels).ok());
  read = ReadTileSums(path);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->classes, 3);
  EXPECT_EQ(read->likelihoods, labels.likelihoods);
  EXPECT_EQ(read->pixels, labels.pixels);
  EXPECT_TRUE(read->photo.empty());

  labels.likelihoods.pop_back();
  ASSERT_TRUE(WriteTileSums(path, labels).ok());
  EXPECT_EQ(ReadTileSums(path).status().code(), absl::StatusCode::kDataLoss) << "one likelihood is missing";
  s.contours.faces[0].face = 2;
  ASSERT_TRUE(WriteTileSums(path, s).ok());
  EXPECT_EQ(ReadTileSums(path).status().code(), absl::StatusCode::kDataLoss) << "a contour of an unknown face";
}

TEST(TileFiles, FacesWithoutConfidenceDoNotLowerTheMean) {
  TileState state;
  EXPECT_EQ(MeanConfidence(state), 0);
  state.confidence = {0, 0.5f, 1, 0};
  EXPECT_EQ(MeanConfidence(state), 0.75);
}

TEST(TileFiles, StateRoundTrip) {
  TileState s;
  s.tile = 4;
  s.vertex_ids = {1, 6, 7};
  s.positions = {{0, 0, 0}, {1.0 / 3, 0, 1e-300}, {0, 1, -0.0}};
  s.face_ids = {11};
  s.labels = {-1};
  s.confidence = {0.25f};
  s.report = R"({"faces":1})";
  const std::string path = TestPath("state.arrays");
  for (const bool in_level : {false, true}) {
    if (in_level) s.level_start = {{1, 2, 3}, {4, 5, 6}, {7, 8, 9}};
    if (in_level) s.last_step = {{0.5f, 0, -1}, {2, 3, 4}, {-5, 6, 7}};
    ASSERT_TRUE(WriteTileState(path, s).ok());
    const auto read = ReadTileState(path);
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_EQ(read->tile, 4);
    EXPECT_EQ(read->vertex_ids, s.vertex_ids);
    EXPECT_EQ(read->positions, s.positions);
    EXPECT_TRUE(std::signbit(read->positions[2].z()));
    EXPECT_EQ(read->level_start, s.level_start);
    EXPECT_EQ(read->last_step, s.last_step);
    EXPECT_EQ(read->face_ids, s.face_ids);
    EXPECT_EQ(read->labels, s.labels);
    EXPECT_EQ(read->confidence, s.confidence);
    EXPECT_EQ(read->report, s.report);
  }
  ExpectDamageFound(path, ReadTileState);
  s.positions.pop_back();
  ASSERT_TRUE(WriteTileState(path, s).ok());
  EXPECT_FALSE(ReadTileState(path).ok()) << "a vertex without a position";
}

TEST(RunTask, UnknownKindAndWrongParametersAreInvalidArguments) {
  const TaskRequest unknown = {"dance", "{}", testing::TempDir(), testing::TempDir()};
  EXPECT_EQ(RunTask(unknown, {}).status().code(), absl::StatusCode::kInvalidArgument);
  for (const char* kind : {"cut", "refine", "measure", "solve", "mend", "publish"}) {
    const TaskRequest request = {kind, "{\"surprise\":1}", testing::TempDir(), testing::TempDir()};
    EXPECT_EQ(RunTask(request, {}).status().code(), absl::StatusCode::kInvalidArgument) << kind;
  }
}

}  // namespace
}  // namespace tessera
