#include "common/exporting/sheet_splitter.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>

#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr double kSplitCell_m = 0.25;  // sheets of 4 m

// A bent grid of 1 m quads in two triangles each, from -20 to 20 m, with positions that no short decimal has.
TriangleMesh SplitterGrid() {
  TriangleMesh mesh;
  constexpr int kSide = 41;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      mesh.vertices.push_back({x - 20 + 0.1 * std::sin(y), y - 20 + 0.1 * std::cos(x), std::sin(0.3 * x * y) / 3});
    }
  }
  for (uint32_t y = 0; y + 1 < kSide; ++y) {
    for (uint32_t x = 0; x + 1 < kSide; ++x) {
      const uint32_t a = y * kSide + x, b = a + 1, c = a + kSide, d = c + 1;
      mesh.faces.push_back({a, b, d});
      mesh.faces.push_back({a, d, c});
      mesh.labels.push_back(static_cast<int32_t>(x % 3) - 1);
      mesh.labels.push_back(static_cast<int32_t>(y % 4) - 1);
    }
  }
  return mesh;
}

float SplitterConfidence(size_t face) { return static_cast<float>(face % 100) / 100; }
float SplitterDisplacement(size_t vertex) { return static_cast<float>(vertex) / 7; }

SplitOptions SplitterOptions() {
  SplitOptions options;
  options.ground = MakeGroundPlane(Eigen::Vector3d::UnitZ(), kSplitCell_m);
  options.has_confidence = options.has_displacement = true;
  return options;
}

class SheetSplitterTest : public testing::Test {
 protected:
  // Splits the mesh with its faces in the order of `faces`; the sheets are in folder().
  StatusOr<std::vector<SheetEntry>> Split(const TriangleMesh& mesh, const std::vector<size_t>& faces,
                                          const SplitOptions& options = SplitterOptions(), bool faces_first = false) {
    TESSERA_ASSIGN_OR_RETURN(SheetSplitter splitter, SheetSplitter::Create(scratch_.path(), options));
    const auto add_vertices = [&] {
      for (size_t v = 0; v < mesh.vertices.size(); ++v) splitter.AddVertex(mesh.vertices[v], SplitterDisplacement(v));
    };
    if (!faces_first) add_vertices();
    for (const size_t f : faces) splitter.AddFace(mesh.faces[f], mesh.labels[f], SplitterConfidence(f));
    if (faces_first) add_vertices();
    return splitter.Finish(sheets_.path(), {});
  }
  StatusOr<std::vector<SheetEntry>> Split(const TriangleMesh& mesh) { return Split(mesh, AllFaces(mesh)); }
  static std::vector<size_t> AllFaces(const TriangleMesh& mesh) {
    std::vector<size_t> faces(mesh.faces.size());
    for (size_t f = 0; f < faces.size(); ++f) faces[f] = f;
    return faces;
  }
  Sheet Read(const SheetId& id) const { return ReadSheet(SheetPath(sheets_.path(), id)).value(); }
  std::map<std::string, std::string> Files() const {
    std::map<std::string, std::string> files;
    const StatusOr<std::vector<std::string>> names = ListFiles(sheets_.path());
    for (const std::string& name : *names) {
      files[name] = ReadFile(sheets_.path() + "/" + name).value();
    }
    return files;
  }

  const TempFolder scratch_ = TempFolder::Create(testing::TempDir()).value();
  const TempFolder sheets_ = TempFolder::Create(testing::TempDir()).value();
};

// Bits of a position, to compare and to search.
std::array<double, 3> SplitterKey(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }

TEST_F(SheetSplitterTest, EveryFaceIsInTheSheetOfItsCentroidOnceWithItsValues) {
  const TriangleMesh mesh = SplitterGrid();
  std::map<std::array<double, 3>, uint32_t> vertex_at;
  for (uint32_t v = 0; v < mesh.vertices.size(); ++v) vertex_at[SplitterKey(mesh.vertices[v])] = v;
  std::map<Triangle, size_t> face_at;
  for (size_t f = 0; f < mesh.faces.size(); ++f) face_at[mesh.faces[f]] = f;

  const StatusOr<std::vector<SheetEntry>> entries = Split(mesh);
  ASSERT_TRUE(entries.ok()) << entries.status();
  EXPECT_GT(entries->size(), 90u);
  EXPECT_EQ(ListFiles(sheets_.path())->size(), entries->size());
  std::set<size_t> found;
  std::set<uint32_t> vertices_found;
  int64_t vertices = 0;
  const GroundPlane ground = SplitterOptions().ground;
  std::vector<std::set<SheetId>> sheets_of(mesh.vertices.size());
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const uint32_t v : mesh.faces[f]) sheets_of[v].insert(SheetOf(ground.Cell(MeshSpans(mesh).Centroid(f))));
  }
  for (const SheetEntry& entry : *entries) {
    const Sheet sheet = Read(entry.id);
    EXPECT_EQ(static_cast<int64_t>(sheet.faces.size()), entry.faces);
    EXPECT_EQ(static_cast<int64_t>(sheet.vertices.size()), entry.vertices);
    std::vector<uint32_t> in_mesh;  // index in the mesh of each vertex
    Eigen::AlignedBox3d box;
    for (size_t v = 0; v < sheet.vertices.size(); ++v) {
      const auto at = vertex_at.find(SplitterKey(sheet.vertices[v]));
      ASSERT_NE(at, vertex_at.end()) << "a vertex that no sheet may change";
      in_mesh.push_back(at->second);
      EXPECT_EQ(sheet.displacement_m[v], SplitterDisplacement(at->second));
      EXPECT_EQ(sheet.shared[v], sheets_of[at->second].size() > 1 ? 1 : 0);
      box.extend(sheet.vertices[v]);
    }
    EXPECT_TRUE(std::is_sorted(in_mesh.begin(), in_mesh.end())) << "the order of the mesh";
    EXPECT_EQ(entry.box.min(), box.min());
    EXPECT_EQ(entry.box.max(), box.max());
    vertices_found.insert(in_mesh.begin(), in_mesh.end());
    vertices += entry.vertices;
    size_t last = 0;
    for (size_t f = 0; f < sheet.faces.size(); ++f) {
      const Triangle& face = sheet.faces[f];
      const auto at = face_at.find({in_mesh[face[0]], in_mesh[face[1]], in_mesh[face[2]]});
      ASSERT_NE(at, face_at.end());
      EXPECT_TRUE(found.insert(at->second).second) << "twice";
      EXPECT_GE(at->second, last) << "the order of the mesh";
      last = at->second;
      EXPECT_EQ(sheet.labels[f], mesh.labels[at->second]);
      EXPECT_EQ(sheet.confidence[f], SplitterConfidence(at->second));
      EXPECT_EQ(SheetOf(ground.Cell(MeshSpans(mesh).Centroid(at->second))), entry.id);
    }
  }
  EXPECT_EQ(found.size(), mesh.faces.size());
  EXPECT_EQ(vertices_found.size(), mesh.vertices.size());
  EXPECT_GT(vertices, static_cast<int64_t>(mesh.vertices.size())) << "no vertex is on a border";
  EXPECT_TRUE(std::is_sorted(entries->begin(), entries->end(), [](const SheetEntry& a, const SheetEntry& b) {
    return std::pair(a.id.y, a.id.x) < std::pair(b.id.y, b.id.x);
  }));
  EXPECT_TRUE(std::filesystem::is_empty(scratch_.path()));
}

TEST_F(SheetSplitterTest, SheetsDoNotDependOnTheOrderOfOtherSheets) {
  const TriangleMesh mesh = SplitterGrid();
  ASSERT_TRUE(Split(mesh).ok());
  const auto files = Files();
  std::vector<size_t> faces = AllFaces(mesh);
  const GroundPlane ground = SplitterOptions().ground;
  const auto sheet_of = [&](size_t f) { return SheetOf(ground.Cell(MeshSpans(mesh).Centroid(f))); };
  std::stable_sort(faces.begin(), faces.end(), [&](size_t a, size_t b) { return sheet_of(b) < sheet_of(a); });
  ASSERT_TRUE(Split(mesh, faces, SplitterOptions(), /*faces_first=*/true).ok());
  EXPECT_EQ(Files(), files);
}

TEST_F(SheetSplitterTest, ValuesThatAreNotKnownStayEmpty) {
  SplitOptions options = SplitterOptions();
  options.has_confidence = options.has_displacement = false;
  const TriangleMesh mesh = SplitterGrid();
  const auto entries = Split(mesh, AllFaces(mesh), options);
  ASSERT_TRUE(entries.ok()) << entries.status();
  const Sheet sheet = Read(entries->front().id);
  EXPECT_TRUE(sheet.confidence.empty());
  EXPECT_TRUE(sheet.displacement_m.empty());
}

TEST_F(SheetSplitterTest, FacesOfOtherSheetsGoToTheNearestAllowedOne) {
  SplitOptions options = SplitterOptions();
  options.allowed = {{3, 0}, {-1, 0}, {0, -1}};
  const TriangleMesh mesh = SplitterGrid();
  const auto entries = Split(mesh, AllFaces(mesh), options);
  ASSERT_TRUE(entries.ok()) << entries.status();
  ASSERT_EQ(entries->size(), 3u);
  EXPECT_EQ((*entries)[0].id, (SheetId{0, -1}));
  EXPECT_EQ((*entries)[1].id, (SheetId{-1, 0}));
  EXPECT_EQ((*entries)[2].id, (SheetId{3, 0}));
  int64_t faces = 0;
  for (const SheetEntry& entry : *entries) faces += entry.faces;
  EXPECT_EQ(faces, static_cast<int64_t>(mesh.faces.size()));
}

TEST(NearestSheetTest, ComparesDistancesBetweenSquaresThenPlaces) {
  const std::vector<SheetId> sheets = {{5, 0}, {0, 5}, {-3, 0}, {0, -3}};
  EXPECT_EQ(NearestSheet({0, 5}, sheets), 1u) << "itself";
  EXPECT_EQ(NearestSheet({4, 1}, sheets), 0u) << "touches at a corner";
  EXPECT_EQ(NearestSheet({0, 0}, sheets), 3u) << "as near as (-3, 0), lower y";
  EXPECT_EQ(NearestSheet({1, 5}, {{0, 5}, {2, 5}, {1, 4}}), 2u) << "all touch: lowest y";
  EXPECT_EQ(NearestSheet({1, 5}, {{2, 5}, {0, 5}}), 1u) << "both touch: lowest x";
  EXPECT_EQ(NearestSheet({1, 5}, {{0, 5}, {2, 5}}), 0u) << "whatever their order";
}

TEST_F(SheetSplitterTest, BadFacesAreErrors) {
  TriangleMesh mesh = SplitterGrid();
  mesh.faces[7][1] = static_cast<uint32_t>(mesh.vertices.size());
  EXPECT_THAT(std::string(Split(mesh).status().message()),
              testing::HasSubstr("face 7: found vertex index 1681, expected an index below 1681"));
  mesh = SplitterGrid();
  mesh.vertices[0].x() = 1e12;
  EXPECT_THAT(std::string(Split(mesh).status().message()), testing::HasSubstr("expected a mesh in the scene's"));
  EXPECT_TRUE(ListFiles(sheets_.path())->empty());
}

TEST_F(SheetSplitterTest, CanBeCancelled) {
  SheetSplitter splitter = SheetSplitter::Create(scratch_.path(), SplitterOptions()).value();
  const TriangleMesh mesh = SplitterGrid();
  for (const Eigen::Vector3d& p : mesh.vertices) splitter.AddVertex(p);
  for (const Triangle& face : mesh.faces) splitter.AddFace(face, 0);
  TaskControl control;
  control.cancelled = [] { return true; };
  EXPECT_EQ(splitter.Finish(sheets_.path(), control).status().code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace tessera
