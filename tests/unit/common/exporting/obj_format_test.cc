#include "common/exporting/obj/obj_format.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <numbers>
#include <set>
#include <sstream>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/exporting/export_map.h"
#include "common/exporting/obj/obj_layout.h"
#include "common/exporting/obj/obj_materials.h"
#include "common/importing/class_map.h"
#include "common/importing/frames.h"
#include "common/importing/mesh_tiles.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr double kObjTile = 25;  // side of a tile in units of the source

// A source with a closed surface, a torus of 56 units, over 3 x 3 tiles.
struct ObjSource {
  std::string crs;
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  // of the torus, in coordinates of the files
  FrameChoice frame = FrameChoice::kGrid;
  HeightOptions heights = {};

  TriangleMesh Torus() const {
    constexpr int kAround = 90, kTube = 40;
    TriangleMesh mesh;
    for (uint32_t i = 0; i < kAround; ++i) {
      for (uint32_t j = 0; j < kTube; ++j) {
        const double u = 2 * std::numbers::pi * (i + 0.3 * std::sin(j)) / kAround, v = 2 * std::numbers::pi * j / kTube,
                     radius = 20 + 8 * std::cos(v);
        mesh.vertices.push_back(centre + Eigen::Vector3d(radius * std::cos(u), radius * std::sin(u), 8 * std::sin(v)));
        const auto at = [&](uint32_t around, uint32_t tube) { return (around % kAround) * kTube + tube % kTube; };
        mesh.faces.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
        mesh.faces.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
        mesh.labels.insert(mesh.labels.end(), 2, static_cast<int32_t>(j / 14) - (i == 5 ? 1 : 0));
      }
    }
    return mesh;
  }

  // Tile_+000_+000, Tile_+000_+001, ...: lines at 12.5 units from the centre.
  void AddTiles(SceneSource* source) const {
    for (int x = 0; x < 3; ++x) {
      for (int y = 0; y < 3; ++y) {
        source->tiles.push_back(absl::StrCat("Tile_+00", x, "_+00", y));
        const double x0 = centre.x() + (x - 1.5) * kObjTile, y0 = centre.y() + (y - 1.5) * kObjTile;
        source->tile_rects.push_back({x0, y0, x0 + kObjTile, y0 + kObjTile});
      }
    }
  }

  SceneMap Map() const {
    StatusOr<SceneMap> map = SceneMap::Choose({crs, offset}, frame, heights, centre);
    EXPECT_TRUE(map.ok()) << map.status();
    return *std::move(map);
  }

  ExportScene Scene() const {
    ExportScene scene;
    const SceneMap map = Map();
    Eigen::Vector3d near = centre;
    EXPECT_TRUE(map.SceneFromSource({&near, 1}).ok());
    scene.frame = *Frame::Around(map.scene(), near);
    scene.gsd_m = 0.01;
    scene.ground.cell_m = 0.5;
    for (const char* const name : {"ground", "roof of \"tiles\"", "roof of 'tiles'"}) {
      scene.classes.emplace_back().name = name;
    }
    scene.source = SceneSource{crs, offset};
    scene.source->heights = heights;
    AddTiles(&*scene.source);
    return scene;
  }

  // `mesh` of coordinates of the files in the local frame of `scene`.
  TriangleMesh InLocal(TriangleMesh mesh, const ExportScene& scene) const {
    EXPECT_TRUE(Map().SceneFromSource(mesh.vertices).ok());
    for (Eigen::Vector3d& v : mesh.vertices) v = scene.frame.LocalFromScene(v);
    return mesh;
  }
};

std::vector<std::pair<SheetId, Sheet>> ObjSheets(const TriangleMesh& mesh, const ExportScene& scene) {
  std::map<std::pair<int, int>, std::vector<size_t>> faces;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const SheetId id = SheetOf(scene.ground.Cell(MeshSpans(mesh).Centroid(f)));
    faces[{id.y, id.x}].push_back(f);
  }
  std::vector<std::pair<SheetId, Sheet>> sheets;
  for (const auto& [place, of_sheet] : faces) {
    Sheet sheet;
    std::map<uint32_t, uint32_t> numbers;
    for (const size_t f : of_sheet) {
      for (const uint32_t v : mesh.faces[f]) numbers[v] = 0;
    }
    for (auto& [v, number] : numbers) {
      number = static_cast<uint32_t>(sheet.vertices.size());
      sheet.vertices.push_back(mesh.vertices[v]);
    }
    for (const size_t f : of_sheet) {
      const Triangle& face = mesh.faces[f];
      sheet.faces.push_back({numbers[face[0]], numbers[face[1]], numbers[face[2]]});
      sheet.labels.push_back(mesh.labels[f]);
    }
    sheets.push_back({{place.second, place.first}, std::move(sheet)});
  }
  return sheets;
}

// Exports `local` to FOLDER/out, by sheets. Returns the names of the files.
StatusOr<std::vector<std::string>> ExportObj(const TriangleMesh& local, const ExportScene& scene,
                                             const ExportOptions& options, const std::string& folder,
                                             int64_t max_faces = kMaxFacesOfObj, const SheetId* set_aside = nullptr) {
  JoinInput join{scene, options, {}};
  for (auto& [id, sheet] : ObjSheets(local, scene)) {
    const std::string of_sheet = absl::StrCat(folder, "/parts/", SheetName(id));
    TESSERA_RETURN_IF_ERROR(EnsureFolder(of_sheet));
    SheetInput input{scene, options, id, std::move(sheet), {}, {}, {}, {}, {}};
    TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> names, WriteObjSheet(input, of_sheet, {}));
    EXPECT_TRUE(names.empty());
    const bool is_set_aside = set_aside != nullptr && *set_aside == id;
    join.sheets.push_back({id, "", absl::StrCat(of_sheet, "/", kPartFile), is_set_aside});
  }
  TESSERA_RETURN_IF_ERROR(EnsureFolder(folder + "/out"));
  return JoinObjUpTo(max_faces, join, folder + "/out", {});
}

struct ObjReadBack {
  MeshSource source;
  MergedMesh merged;
  TriangleMesh mesh;  // coordinates of the files
};

// As `tessera import` reads the folder.
ObjReadBack ReadObjFolder(const std::string& folder, MergeOptions options = {}) {
  StatusOr<MeshSource> source = FindMeshSource(folder);
  EXPECT_TRUE(source.ok()) << source.status();
  if (!source.ok()) return {};
  MeshSource without_offset = *source;
  without_offset.offset.setZero();
  options.weld_m = 1e-8;  // the same text
  StatusOr<MergedMesh> merged = MergeMeshes(without_offset, options, folder + "/../merged.ply", nullptr);
  EXPECT_TRUE(merged.ok()) << merged.status();
  if (!merged.ok()) return {};
  return {*std::move(source), *std::move(merged), ReadPly(folder + "/../merged.ply").value().mesh};
}

int64_t OpenObjEdges(const TriangleMesh& mesh) {
  std::map<std::pair<uint32_t, uint32_t>, int> edges;
  for (const Triangle& face : mesh.faces) {
    for (size_t k = 0; k < 3; ++k) {
      ++edges[{face[k], face[(k + 1) % 3]}];
      --edges[{face[(k + 1) % 3], face[k]}];
    }
  }
  int64_t open = 0;
  for (const auto& [edge, count] : edges) open += count != 0;
  return open;
}

// Area by label, -1 first.
std::map<int32_t, double> ObjAreaOfLabels(const TriangleMesh& mesh) {
  std::map<int32_t, double> areas;
  for (size_t f = 0; f < mesh.faces.size(); ++f) areas[mesh.labels.empty() ? 0 : mesh.labels[f]] += FaceArea(mesh, f);
  return areas;
}

// Every vertex of `expected` is one of `found` within `tolerance`. Returns the others of `found`.
std::vector<Eigen::Vector3d> ExpectObjVertices(const TriangleMesh& found, const TriangleMesh& expected,
                                               double tolerance) {
  std::multimap<double, Eigen::Vector3d> by_x;
  for (const Eigen::Vector3d& v : found.vertices) by_x.emplace(v.x(), v);
  for (const Eigen::Vector3d& v : expected.vertices) {
    const auto end = by_x.upper_bound(v.x() + tolerance);
    const auto same = std::find_if(by_x.lower_bound(v.x() - tolerance), end,
                                   [&](const auto& other) { return (other.second - v).norm() < tolerance; });
    EXPECT_TRUE(same != end) << v.transpose();
    if (same != end) by_x.erase(same);
  }
  std::vector<Eigen::Vector3d> others;
  for (const auto& entry : by_x) others.push_back(entry.second);
  return others;
}

class ObjFormatTest : public testing::Test {
 protected:
  ObjFormatTest() : folder_(TempFolder::Create(testing::TempDir()).value()), out_(folder_.path() + "/out") {}
  std::string Content(const std::string& name) const { return ReadFile(out_ + "/" + name).value_or(""); }

  const TempFolder folder_;
  const std::string out_;
};

ObjSource ObjProjected() {
  return {"EPSG:25833", {391000.5, 5820000.25, 30}, {210.125, 87.5, 12}, FrameChoice::kGrid, {}};
}

TEST_F(ObjFormatTest, TheSurfaceComesBackInTheTilesOfTheSourceInAnySystem) {
  HeightOptions geoid, ellipsoid;
  geoid.geoid_height_m = 44.5;
  ellipsoid.ellipsoid = true;
  const std::vector<ObjSource> sources = {
      ObjProjected(),
      {"EPSG:25833", {391000.5, 5820000.25, 30}, {210.125, 87.5, 12}, FrameChoice::kTrue, {}},
      {"EPSG:25833+5773", {391000, 5820000, 0}, {210.125, 87.5, 12}, FrameChoice::kGrid, geoid},
      {"EPSG:25833+5773", {391000, 5820000, 0}, {210.125, 87.5, 12}, FrameChoice::kTrue, geoid},
      {"EPSG:25833+5773", {391000, 5820000, 0}, {210.125, 87.5, 12}, FrameChoice::kTrue, ellipsoid},
      {"EPSG:2263", {1000000, 200000, 0}, {-17, 3.5, 120}, FrameChoice::kGrid, {}},
      {"EPSG:2263", {1000000, 200000, 0}, {-17, 3.5, 120}, FrameChoice::kTrue, {}},
      {"ENU:60.17,24.94", {0, 0, 0}, {12, -7.25, 20}, FrameChoice::kTrue, {}},
      {"", {0, 0, 0}, {3, 4, 5}, FrameChoice::kGrid, {}},
      {"", {500, 600, 0}, {3, 4, 5}, FrameChoice::kGrid, {}}};
  for (const ObjSource& source : sources) {
    SCOPED_TRACE(absl::StrCat(source.crs, " ", source.heights.ellipsoid, source.heights.geoid_height_m.value_or(0)));
    const ExportScene scene = source.Scene();
    const TriangleMesh mesh = source.Torus(), local = source.InLocal(mesh, scene);
    ASSERT_TRUE(RemoveTree(folder_.path() + "/out").ok());
    const StatusOr<std::vector<std::string>> names = ExportObj(local, scene, {}, folder_.path());
    ASSERT_TRUE(names.ok()) << names.status();
    EXPECT_EQ(names->size(), source.crs.empty() && source.offset.isZero() ? 9u : 10u);
    EXPECT_EQ(names->front(), "Data/Tile_+000_+000/Tile_+000_+000.obj");

    const ObjReadBack read = ReadObjFolder(out_);
    EXPECT_EQ(read.source.tile_names, scene.source->tiles);
    EXPECT_EQ(read.source.crs, source.crs);
    EXPECT_EQ(read.source.offset, source.offset);
    EXPECT_EQ(OpenObjEdges(read.mesh), 0);
    const double area = ObjAreaOfLabels(read.mesh)[0];
    double expected_area = 0;
    for (size_t f = 0; f < mesh.faces.size(); ++f) expected_area += FaceArea(mesh, f);
    EXPECT_NEAR(area, expected_area, 1e-6 * expected_area);
    for (const Eigen::Vector3d& cut : ExpectObjVertices(read.mesh, mesh, 1e-6)) {
      const Eigen::Vector2d from_centre = (cut - source.centre).head<2>().cwiseAbs();
      EXPECT_TRUE(from_centre.x() == kObjTile / 2 || from_centre.y() == kObjTile / 2) << cut.transpose();
    }
    EXPECT_EQ(read.mesh.vertices.size() * 2, read.mesh.faces.size());  // a torus without repeated vertices
    for (size_t t = 0; t < read.merged.tile_rects.size(); ++t) {
      const PlanRect &found = read.merged.tile_rects[t], &tile = scene.source->tile_rects[t];
      EXPECT_TRUE(t / 3 == 0 || found.x0 >= tile.x0) << t;
      EXPECT_TRUE(t / 3 == 2 || found.x1 <= tile.x1) << t;
      EXPECT_TRUE(t % 3 == 0 || found.y0 >= tile.y0) << t;
      EXPECT_TRUE(t % 3 == 2 || found.y1 <= tile.y1) << t;
    }
  }
}

TEST_F(ObjFormatTest, ClassesAreMaterials) {
  const ObjSource source = ObjProjected();
  const ExportScene scene = source.Scene();
  const TriangleMesh mesh = source.Torus();
  ExportOptions options;
  options.class_materials = true;
  const StatusOr<std::vector<std::string>> names =
      ExportObj(source.InLocal(mesh, scene), scene, options, folder_.path());
  ASSERT_TRUE(names.ok()) << names.status();
  EXPECT_THAT(*names, testing::IsSupersetOf({"classes.json", "metadata.xml", "Data/Tile_+001_+002/classes.mtl"}));
  EXPECT_THAT(Content("Data/Tile_+001_+002/classes.mtl"), HasSubstr("newmtl roof_of__tiles__2\nKd 0.784314"));
  EXPECT_TRUE(Content("Data/Tile_+001_+002/Tile_+001_+002.obj").starts_with("mtllib classes.mtl\nv "));

  MergeOptions merge;
  merge.labels = LabelSource::kMaterial;
  for (const SceneClass& c : scene.classes) merge.classes.push_back(c.name);
  merge.class_map = ParseClassMap(Content("classes.json"), "classes.json").value();
  const ObjReadBack read = ReadObjFolder(out_, merge);
  EXPECT_EQ(read.merged.classes, merge.classes);
  EXPECT_GT(read.merged.faces_without_class, 0);
  std::map<int32_t, double> found = ObjAreaOfLabels(read.mesh), expected = ObjAreaOfLabels(mesh);
  EXPECT_EQ(found.size(), 4u);
  for (const auto& [label, area] : expected) EXPECT_NEAR(found[label], area, 1e-6 * area) << label;
}

TEST_F(ObjFormatTest, NamesOfMaterialsAreWordsAndDiffer) {
  std::vector<SceneClass> classes;
  for (const char* const name : {"roof", "a b\n#c", "a_b__c", "unclassified", "<img src=x>", "b\xc3\xa2timent", " "}) {
    classes.emplace_back().name = name;
  }
  EXPECT_THAT(ObjMaterialNames(classes), ElementsAre("roof", "a_b__c", "a_b__c_2", "unclassified", "_img_src_x_",
                                                     "b\xc3\xa2timent", "_", "unclassified_2"));
  EXPECT_EQ(ParseClassMap(ObjClassMap(classes), "classes.json")->at("a_b__c"), "a b\n#c");
}

TEST_F(ObjFormatTest, WithoutTilesTheCityIsOneFileOrAFileASheet) {
  ObjSource source;
  ExportScene scene = source.Scene();
  scene.source.reset();
  const TriangleMesh mesh = source.Torus(), local = source.InLocal(mesh, scene);
  StatusOr<std::vector<std::string>> names = ExportObj(local, scene, {}, folder_.path());
  ASSERT_TRUE(names.ok()) << names.status();
  EXPECT_THAT(*names, ElementsAre("mesh.obj"));
  ObjReadBack read = ReadObjFolder(out_);
  EXPECT_EQ(OpenObjEdges(read.mesh), 0);
  EXPECT_EQ(read.mesh.vertices.size(), mesh.vertices.size());
  EXPECT_EQ(read.mesh.faces.size(), mesh.faces.size());
  EXPECT_TRUE(ExpectObjVertices(read.mesh, mesh, 1e-6).empty());

  fs::remove_all(out_);
  names = ExportObj(local, scene, {}, folder_.path(), /*max_faces=*/static_cast<int64_t>(mesh.faces.size()) - 1);
  ASSERT_TRUE(names.ok()) << names.status();
  EXPECT_EQ(names->size(), ObjSheets(local, scene).size());
  EXPECT_EQ(names->front(), "Data/Tile_+000_+001/Tile_+000_+001.obj");
  EXPECT_THAT(*names, testing::Contains("Data/Tile_-001_+002/Tile_-001_+002.obj"));
  read = ReadObjFolder(out_);
  EXPECT_EQ(OpenObjEdges(read.mesh), 0);
  EXPECT_EQ(read.mesh.vertices.size(), mesh.vertices.size());
}

TEST_F(ObjFormatTest, FilesWithQuarantinedTilesSayIt) {
  ObjSource source;
  ExportScene scene = source.Scene();
  scene.source.reset();
  const TriangleMesh local = source.InLocal(source.Torus(), scene);
  const SheetId set_aside = ObjSheets(local, scene).front().first;
  const StatusOr<std::vector<std::string>> names =
      ExportObj(local, scene, {}, folder_.path(), /*max_faces=*/10, &set_aside);
  ASSERT_TRUE(names.ok()) << names.status();
  for (const std::string& name : *names) {
    const bool is_set_aside = name.find(absl::StrFormat("Tile_%+04d_%+04d", set_aside.x, set_aside.y)) != name.npos;
    EXPECT_EQ(absl::StartsWith(Content(name), "# quarantined: "), is_set_aside) << name;
  }
  EXPECT_EQ(OpenObjEdges(ReadObjFolder(out_).mesh), 0);
}

TEST_F(ObjFormatTest, TilesWithoutRectanglesAreNotGuessed) {
  const ObjSource source = ObjProjected();
  ExportScene scene = source.Scene();
  scene.source->tile_rects.clear();
  const TriangleMesh mesh = source.Torus();
  EXPECT_THAT(*ExportObj(source.InLocal(mesh, scene), scene, {}, folder_.path()),
              ElementsAre("mesh.obj", "metadata.xml"));
  EXPECT_TRUE(ExpectObjVertices(ReadObjFolder(out_).mesh, mesh, 1e-6).empty());
}

TEST_F(ObjFormatTest, AnotherSystemKeepsTheTiles) {
  const ObjSource source = ObjProjected();
  const ExportScene scene = source.Scene();
  const TriangleMesh mesh = source.Torus(), local = source.InLocal(mesh, scene);
  ExportOptions options;
  options.crs = "EPSG:32632";
  ASSERT_TRUE(ExportObj(local, scene, options, folder_.path()).ok());
  const ObjReadBack read = ReadObjFolder(out_);
  EXPECT_EQ(read.source.crs, "EPSG:32632");
  EXPECT_EQ(read.source.tile_names, scene.source->tiles);
  EXPECT_EQ(OpenObjEdges(read.mesh), 0);
  for (const double coordinate : read.source.offset) EXPECT_EQ(std::fmod(coordinate, 1000), 0);
  TriangleMesh expected = local;
  ASSERT_TRUE(ExportMap::Open(scene, "EPSG:32632")->FromLocal(expected.vertices).ok());
  for (Eigen::Vector3d& v : expected.vertices) v -= read.source.offset;
  ExpectObjVertices(read.mesh, expected, 1e-6);
  for (const Eigen::Vector3d& v : read.mesh.vertices) EXPECT_LT(v.cwiseAbs().maxCoeff(), 1000);
}

TEST_F(ObjFormatTest, ASceneThatWasNotImportedStatesItsSystem) {
  ObjSource source = {"EPSG:32633", {391000, 5820000, 0}, {210.125, 87.5, 12}, FrameChoice::kGrid, {}};
  ExportScene scene = source.Scene();
  scene.source.reset();
  const TriangleMesh mesh = source.Torus();
  EXPECT_THAT(*ExportObj(source.InLocal(mesh, scene), scene, {}, folder_.path()),
              ElementsAre("mesh.obj", "metadata.xml"));
  const ObjReadBack read = ReadObjFolder(out_);
  EXPECT_EQ(read.source.crs, "EPSG:32633");
  EXPECT_EQ(read.source.offset, Eigen::Vector3d(391000, 5820000, 0));
  EXPECT_TRUE(ExpectObjVertices(read.mesh, mesh, 1e-6).empty());
}

TEST_F(ObjFormatTest, HostileNamesOfTilesAreRefusedBeforeWork) {
  const ObjSource source = ObjProjected();
  ExportScene scene = source.Scene();
  ExportOptions options;
  options.formats = {"obj"};
  EXPECT_TRUE(CheckExport(options, scene).ok()) << CheckExport(options, scene);
  const std::vector<std::string> names = {"..",
                                          "../x",
                                          "a/../../b",
                                          "/etc/x",
                                          "a//b",
                                          "a\nb",
                                          "a/.",
                                          "c:\\x",
                                          std::string("a\0b", 3),
                                          std::string(300, 'x')};
  for (const std::string& name : names) {
    scene.source->tiles[4] = name;
    const Status status = CheckExport(options, scene);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << name;
    EXPECT_THAT(std::string(status.message()), HasSubstr("scene.json: source.tiles[4]: found "));
    EXPECT_FALSE(ExportObj(source.InLocal(source.Torus(), scene), scene, options, folder_.path()).ok()) << name;
  }
  scene.source->tiles[4] = scene.source->tiles[0];
  EXPECT_THAT(std::string(CheckExport(options, scene).message()), HasSubstr("expected a name that no other tile has"));
}

TEST_F(ObjFormatTest, NamesWithFoldersAreReadAsTheyWere) {
  const ObjSource source = ObjProjected();
  ExportScene scene = source.Scene();
  for (size_t k = 0; k < 9; ++k) scene.source->tiles[k] = absl::StrCat("block ", k / 3, "/", k % 3, "/mesh");
  ASSERT_TRUE(ExportObj(source.InLocal(source.Torus(), scene), scene, {}, folder_.path()).ok());
  EXPECT_EQ(FindMeshSource(out_ + "/Data")->tile_names, scene.source->tiles);
}

TEST_F(ObjFormatTest, MetadataEscapesTheSystem) {
  const std::string crs =
      R"(GEOGCS["WGS 84 & <b>",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],)"
      R"(AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]])";
  const StatusOr<ExportMap> map = ExportMap::Open(ObjProjected().Scene(), crs);
  ASSERT_TRUE(map.ok()) << map.status();
  const std::string text = ObjMetadata(*map, {5e6, -1.0 / 3, 0});
  EXPECT_THAT(text, HasSubstr("<SRSOrigin>5000000,-0.3333"));
  const StatusOr<ModelMetadata> metadata = ParseModelMetadata(text, "metadata.xml");
  ASSERT_TRUE(metadata.ok()) << metadata.status();
  EXPECT_EQ(metadata->crs, crs);
  EXPECT_EQ(metadata->origin, Eigen::Vector3d(5e6, -1.0 / 3, 0));
}

TEST_F(ObjFormatTest, CoordinatesHaveNineDecimals) {
  const ObjSource source = ObjProjected();
  const ExportScene scene = source.Scene();
  ASSERT_TRUE(ExportObj(source.InLocal(source.Torus(), scene), scene, {}, folder_.path()).ok());
  EXPECT_EQ(Content("metadata.xml"),
            "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<ModelMetadata version=\"1\">\n  <SRS>EPSG:25833</SRS>\n"
            "  <SRSOrigin>391000.5,5820000.25,30</SRSOrigin>\n</ModelMetadata>\n");
  std::istringstream lines(Content("Data/Tile_+001_+000/Tile_+001_+000.obj"));
  std::string v, x, y, z;
  lines >> v >> x >> y >> z;
  EXPECT_EQ(v, "v");
  for (const std::string& number : {x, y, z}) EXPECT_EQ(number.size() - number.find('.'), 10u) << number;
}

TEST_F(ObjFormatTest, TheSameInputGivesTheSameBytes) {
  const ObjSource source = ObjProjected();
  const ExportScene scene = source.Scene();
  const TriangleMesh local = source.InLocal(source.Torus(), scene);
  ExportOptions options;
  options.class_materials = true;
  const std::vector<std::string> names = ExportObj(local, scene, options, folder_.path()).value();
  std::vector<std::string> contents;
  for (const std::string& name : names) contents.push_back(Content(name));
  EXPECT_EQ(ExportObj(local, scene, options, folder_.path()).value(), names);
  for (size_t k = 0; k < names.size(); ++k) EXPECT_EQ(Content(names[k]), contents[k]) << names[k];
  EXPECT_EQ(ListFiles(out_)->size(), names.size());  // no temporary files
}

TEST_F(ObjFormatTest, ADamagedPartIsRefused) {
  const ObjSource source = ObjProjected();
  const ExportScene scene = source.Scene();
  const TriangleMesh local = source.InLocal(source.Torus(), scene);
  ASSERT_TRUE(ExportObj(local, scene, {}, folder_.path()).ok());
  const std::string part = absl::StrCat(folder_.path(), "/parts/", ListFiles(folder_.path() + "/parts")->front());
  std::string bytes = ReadFile(part).value();
  bytes[bytes.size() - 100] ^= 1;
  std::ofstream(part, std::ios::binary) << bytes;
  const ExportOptions options;
  const JoinInput join{scene, options, {{{0, 0}, "", part}}};
  EXPECT_EQ(JoinObj(join, out_, {}).status().code(), absl::StatusCode::kDataLoss);
}

}  // namespace
}  // namespace tessera
