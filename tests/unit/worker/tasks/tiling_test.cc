// Cutting a city into tiles and putting it together again.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <numeric>

#include "common/base/random.h"
#include "tests/support/tiny_scene.h"
#include "worker/tasks/cell_views.h"
#include "worker/tasks/cut_tile.h"
#include "worker/tasks/merge_cores.h"
#include "worker/tasks/report.h"
#include "worker/tasks/stitch_tile.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

constexpr double kHalo_m = 5, kBlend_m = 3;
constexpr int64_t kBlockFaces = 60;  // so that the toy has many blocks

struct TinyCity {
  TriangleMesh mesh;  // of the whole city
  CityReader city;
  Survey survey;
};

TinyCity MakeCity() {
  TinyCity tiny;
  const TinyScene scene = MakeTinyScene();
  tiny.mesh = scene.mesh;
  std::vector<uint32_t> input_face(scene.mesh.faces.size());
  std::iota(input_face.begin(), input_face.end(), 0u);
  Survey& s = tiny.survey;
  s.gsd_m = 0.2;
  s.ground = MakeGroundPlane(s.up, 4);
  s.classes.resize(3);
  for (size_t v = 0; v < scene.cameras.size(); ++v) {
    SceneView view;
    view.name = scene.image_names[v];
    view.camera = scene.cameras[v];
    view.lens.pinhole = view.camera.intrinsics;
    s.views.push_back(view);
  }
  s.faces = static_cast<int64_t>(scene.mesh.faces.size());
  s.cells = CellsOf(tiny.mesh, s.ground);
  const std::string path = FreshTestFolder("city") + "/city.arrays";
  const Status written = WriteCity(path, {tiny.mesh, input_face}, s.ground, s.cells, testing::TempDir(), kBlockFaces);
  EXPECT_TRUE(written.ok()) << written;
  auto opened = CityReader::Open(path);
  EXPECT_TRUE(opened.ok()) << opened.status();
  tiny.city = *std::move(opened);
  const Status chosen = ChooseViews(tiny.mesh, tiny.city, {}, {}, testing::TempDir(), &s);
  EXPECT_TRUE(chosen.ok()) << chosen;
  return tiny;
}

// Random cuts of the plane into columns and rows of cells.
std::vector<TileParameters> RandomTiles(const Survey& survey, Random* random) {
  CellRect all = {1000, 1000, -1000, -1000};
  for (const SurveyCell& cell : survey.cells) {
    all = {std::min(all.x0, cell.x), std::min(all.y0, cell.y), std::max(all.x1, cell.x + 1),
           std::max(all.y1, cell.y + 1)};
  }
  const auto cuts = [random](int low, int high) {
    std::vector<int> borders = {low};
    while (borders.back() < high) borders.push_back(std::min<int>(high, borders.back() + 1 + random->Below(5)));
    return borders;
  };
  std::vector<TileParameters> tiles;
  const std::vector<int> columns = cuts(all.x0, all.x1), rows = cuts(all.y0, all.y1);
  for (size_t r = 0; r + 1 < rows.size(); ++r) {
    for (size_t c = 0; c + 1 < columns.size(); ++c) {
      tiles.push_back({static_cast<int>(tiles.size()), {columns[c], rows[r], columns[c + 1], rows[r + 1]}});
    }
  }
  return tiles;
}

std::vector<int32_t> AllViews(const Survey& survey) {
  std::vector<int32_t> views;
  for (size_t v = 0; v < survey.views.size(); ++v) views.push_back(static_cast<int32_t>(v));
  return views;
}

// What refining would give if `displace` moved the vertices and labels were certain.
template <class Displace>
TileResult ResultOf(const TilePackage& package, const Displace& displace) {
  TileResult result;
  result.tile = package.tile;
  result.vertex_ids = package.vertex_ids;
  result.face_ids = package.face_ids;
  result.classes = static_cast<int>(package.classes.size());
  result.labels = package.mesh.labels;
  for (size_t v = 0; v < package.vertex_ids.size(); ++v) {
    result.positions.push_back(package.mesh.vertices[v] + displace(v));
  }
  for (const int32_t label : result.labels) {
    for (int l = 0; l < result.classes; ++l) result.beliefs.push_back(l == label ? 0.0f : 1.0f);
  }
  result.seen.assign(result.labels.size(), 1);
  return result;
}

struct Tiled {
  std::vector<TilePackage> packages;
  std::vector<TileParameters> tiles;
};

Tiled CutAll(const TinyCity& tiny, const std::vector<TileParameters>& tiles) {
  Tiled tiled;
  for (const TileParameters& tile : tiles) {
    auto package = CutTile(tiny.city, tiny.survey, {tile, kHalo_m, AllViews(tiny.survey)});
    if (!package.ok()) continue;  // nothing in its core
    tiled.tiles.push_back(tile);
    tiled.packages.push_back(*std::move(package));
  }
  return tiled;
}

std::vector<TileCore> StitchAll(const Tiled& tiled, const std::vector<TileResult>& results) {
  std::vector<TileCore> cores;
  for (size_t t = 0; t < tiled.tiles.size(); ++t) {
    auto core = StitchTile(tiled.packages[t], results, {tiled.tiles[t], kBlend_m, tiled.tiles});
    EXPECT_TRUE(core.ok()) << core.status();
    cores.push_back(*std::move(core));
  }
  return cores;
}

Status MergeInto(const CityReader& city, const std::vector<TileCore>& cores, TriangleMesh* merged) {
  std::vector<CoreSpans> spans;
  for (const TileCore& core : cores) spans.emplace_back(core);
  TESSERA_ASSIGN_OR_RETURN(const CoreMerger merger, CoreMerger::Create(city, spans));
  TESSERA_RETURN_IF_ERROR(
      merger.ForEachVertex([&](const MergedVertex& vertex) { merged->vertices.push_back(vertex.after); }));
  return merger.ForEachFace([&](const MergedFace& face) {
    merged->faces.push_back(face.vertices);
    merged->labels.push_back(face.label);
  });
}

TriangleMesh Merge(const CityReader& city, const std::vector<TileCore>& cores) {
  TriangleMesh merged;
  const Status status = MergeInto(city, cores, &merged);
  EXPECT_TRUE(status.ok()) << status;
  return merged;
}

bool SameBytes(const TriangleMesh& a, const TriangleMesh& b) {
  return a.faces == b.faces && a.labels == b.labels && a.vertices.size() == b.vertices.size() &&
         std::memcmp(a.vertices.data(), b.vertices.data(), a.vertices.size() * sizeof(Eigen::Vector3d)) == 0;
}

TEST(Tiling, EveryFaceIsInExactlyOneCoreAndStandingStillChangesNoByte) {
  const TinyCity tiny = MakeCity();
  for (uint64_t seed = 0; seed < 12; ++seed) {
    Random random(seed);
    const Tiled tiled = CutAll(tiny, RandomTiles(tiny.survey, &random));
    std::vector<TileResult> results;
    for (const TilePackage& package : tiled.packages) {
      results.push_back(ResultOf(package, [](size_t) { return Eigen::Vector3d::Zero(); }));
    }
    EXPECT_TRUE(SameBytes(Merge(tiny.city, StitchAll(tiled, results)), tiny.mesh)) << "seed " << seed;
  }
}

// Tiles that disagree at random: the merger accepts only seams that are equal byte for byte.
TEST(Tiling, SeamsAreEqualOnBothSidesForAnyResultsAndAnyOrder) {
  const TinyCity tiny = MakeCity();
  for (uint64_t seed = 0; seed < 12; ++seed) {
    Random random(seed);
    const Tiled tiled = CutAll(tiny, RandomTiles(tiny.survey, &random));
    std::vector<TileResult> results;
    for (const TilePackage& package : tiled.packages) {
      results.push_back(ResultOf(package, [&](size_t v) {
        return package.fixed[v] ? Eigen::Vector3d(0, 0, 0)
                                : Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal());
      }));
    }
    std::vector<TileCore> cores = StitchAll(tiled, results);
    const TriangleMesh merged = Merge(tiny.city, cores);
    for (size_t i = cores.size(); i > 1; --i) std::swap(cores[i - 1], cores[random.Below(static_cast<int64_t>(i))]);
    EXPECT_TRUE(SameBytes(Merge(tiny.city, cores), merged)) << "seed " << seed;
  }
}

TEST(Tiling, WhatAllTilesAgreeOnIsKept) {
  const TinyCity tiny = MakeCity();
  Random random(5);
  const Tiled tiled = CutAll(tiny, RandomTiles(tiny.survey, &random));
  std::vector<TileResult> results;
  const auto move = [](uint32_t id) { return Eigen::Vector3d(0.1 * id, 1.0 / (id + 1), -0.3); };
  for (const TilePackage& package : tiled.packages) {
    results.push_back(ResultOf(package, [&](size_t v) { return move(package.vertex_ids[v]); }));
  }
  const TriangleMesh merged = Merge(tiny.city, StitchAll(tiled, results));
  for (size_t v = 0; v < merged.vertices.size(); ++v) {
    const Eigen::Vector3d expected = tiny.mesh.vertices[v] + move(static_cast<uint32_t>(v));
    EXPECT_NEAR((merged.vertices[v] - expected).norm(), 0, 1e-9);
  }
}

TEST(Tiling, FacesThatNoViewShowsHaveNoConfidence) {
  const TinyCity tiny = MakeCity();
  Random random(5);
  const Tiled tiled = CutAll(tiny, RandomTiles(tiny.survey, &random));
  const uint32_t unseen = tiled.packages[0].face_ids[0];
  std::vector<TileResult> results;
  for (const TilePackage& package : tiled.packages) {
    results.push_back(ResultOf(package, [](size_t) { return Eigen::Vector3d::Zero(); }));
    for (size_t f = 0; f < package.face_ids.size(); ++f) results.back().seen[f] = package.face_ids[f] != unseen;
  }
  int found = 0;
  for (const TileCore& core : StitchAll(tiled, results)) {
    for (size_t f = 0; f < core.face_ids.size(); ++f) {
      EXPECT_EQ(core.confidence[f] == 0, core.face_ids[f] == unseen);
      found += core.face_ids[f] == unseen;
    }
  }
  EXPECT_EQ(found, 1);
}

TEST(Tiling, MergerRefusesGapsOverlapsAndCracks) {
  const TinyCity tiny = MakeCity();
  Random random(5);
  const Tiled tiled = CutAll(tiny, RandomTiles(tiny.survey, &random));
  ASSERT_GT(tiled.tiles.size(), 1u);
  std::vector<TileResult> results;
  for (const TilePackage& package : tiled.packages) {
    results.push_back(ResultOf(package, [](size_t) { return Eigen::Vector3d::Zero(); }));
  }
  const std::vector<TileCore> cores = StitchAll(tiled, results);
  TriangleMesh unused;
  EXPECT_TRUE(MergeInto(tiny.city, cores, &unused).ok());
  const std::vector<TileCore> gap(cores.begin() + 1, cores.end());
  EXPECT_EQ(MergeInto(tiny.city, gap, &unused).code(), absl::StatusCode::kDataLoss);
  std::vector<TileCore> overlap = cores;
  overlap.push_back(cores[0]);
  EXPECT_EQ(MergeInto(tiny.city, overlap, &unused).code(), absl::StatusCode::kDataLoss);
  std::vector<TileCore> crack = cores;
  for (Eigen::Vector3d& p : crack[0].positions) p.z() = std::nextafter(p.z(), 1e9);
  EXPECT_EQ(MergeInto(tiny.city, crack, &unused).code(), absl::StatusCode::kDataLoss);
  std::vector<TileCore> stranger = cores;
  stranger[0].face_ids.back() = static_cast<uint32_t>(tiny.mesh.faces.size());
  EXPECT_EQ(MergeInto(tiny.city, stranger, &unused).code(), absl::StatusCode::kDataLoss);
}

TEST(CutTile, FixesExactlyTheVerticesThatFacesOutsideUse) {
  const TinyCity tiny = MakeCity();
  Random random(2);
  const TriangleMesh& mesh = tiny.mesh;
  for (const TilePackage& package : CutAll(tiny, RandomTiles(tiny.survey, &random)).packages) {
    std::vector<int> faces_in(mesh.vertices.size(), 0), faces_all(mesh.vertices.size(), 0);
    for (const Triangle& face : mesh.faces) {
      for (const uint32_t v : face) ++faces_all[v];
    }
    for (const uint32_t f : package.face_ids) {
      for (const uint32_t v : mesh.faces[f]) ++faces_in[v];
    }
    for (size_t v = 0; v < package.vertex_ids.size(); ++v) {
      const uint32_t id = package.vertex_ids[v];
      EXPECT_EQ(package.fixed[v] != 0, faces_in[id] < faces_all[id]);
      EXPECT_EQ(package.mesh.vertices[v], mesh.vertices[id]);
    }
    for (size_t f = 0; f < package.face_ids.size(); ++f) {
      for (int k = 0; k < 3; ++k) {
        EXPECT_EQ(package.vertex_ids[package.mesh.faces[f][k]], mesh.faces[package.face_ids[f]][k]);
      }
    }
  }
}

// With its occluders a tile looks from every view as it does within the whole city.
TEST(CutTile, OccludersHideWhatTheCityHides) {
  const TinyCity tiny = MakeCity();
  Random random(3);
  int64_t seen = 0, hidden = 0;
  for (const TilePackage& package : CutAll(tiny, RandomTiles(tiny.survey, &random)).packages) {
    std::map<int32_t, int32_t> local;
    for (size_t f = 0; f < package.face_ids.size(); ++f) {
      local[static_cast<int32_t>(package.face_ids[f])] = static_cast<int32_t>(f);
    }
    for (const SceneView& view : package.views) {
      const FaceMap whole = RasterizeFaces(tiny.mesh, nullptr, view.camera);
      const FaceMap tile = RasterizeFaces(package.mesh, &package.occluders, view.camera);
      const FaceMap bare = RasterizeFaces(package.mesh, nullptr, view.camera);
      for (size_t i = 0; i < whole.face.size(); ++i) {
        const auto it = local.find(whole.face[i]);
        const int32_t expected = it == local.end() ? -1 : it->second;
        ASSERT_EQ(tile.face[i], expected);
        seen += expected >= 0;
        hidden += bare.face[i] >= 0 && expected < 0;
      }
    }
  }
  EXPECT_GT(seen, 0);
  EXPECT_GT(hidden, 0) << "or the test shows nothing";
}

TEST(CutTile, RefusesACoreWithoutFaces) {
  const TinyCity tiny = MakeCity();
  const CutParameters far = {{0, {1000, 1000, 1001, 1001}}, kHalo_m, {}};
  EXPECT_EQ(CutTile(tiny.city, tiny.survey, far).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(CityFile, BlocksGiveTheMeshBackWhateverTheirSize) {
  const TinyScene scene = MakeTinyScene();
  std::vector<uint32_t> input_face(scene.mesh.faces.size());
  std::iota(input_face.begin(), input_face.end(), 5u);
  const GroundPlane ground = MakeGroundPlane(Eigen::Vector3d::UnitZ(), 4);
  const std::vector<SurveyCell> cells = CellsOf(scene.mesh, ground);
  const std::string path = FreshTestFolder("blocks") + "/city.arrays";
  size_t blocks = 0;
  for (const int64_t max_faces : {1 << 20, 200, 1}) {
    ASSERT_TRUE(WriteCity(path, {scene.mesh, input_face}, ground, cells, testing::TempDir(), max_faces).ok());
    const auto city = ReadCity(path);
    ASSERT_TRUE(city.ok()) << city.status();
    EXPECT_TRUE(SameBytes(city->mesh, scene.mesh));
    EXPECT_EQ(city->input_face, std::vector<int64_t>(input_face.begin(), input_face.end()));
    const auto reader = CityReader::Open(path);
    ASSERT_TRUE(reader.ok());
    EXPECT_GT(reader->block_count(), blocks);
    blocks = reader->block_count();
    int64_t faces = 0;
    for (size_t b = 0; b < blocks; ++b) {
      const auto block = reader->Block(b);
      ASSERT_TRUE(block.ok());
      EXPECT_TRUE(block->face_ids.size() <= static_cast<size_t>(max_faces) ||
                  (block->cells.x1 == block->cells.x0 + 1 && block->cells.y1 == block->cells.y0 + 1));
      faces += static_cast<int64_t>(block->face_ids.size());
      for (size_t f = 0; f < block->face_ids.size(); ++f) {
        EXPECT_TRUE(block->cells.Contains(ground.Cell(block->mesh.Centroid(f))));
      }
    }
    EXPECT_EQ(faces, reader->faces());
  }
  EXPECT_EQ(blocks, cells.size());
}

TEST(CityFile, DamageIsFoundWhereItIs) {
  const TinyCity tiny = MakeCity();
  const std::string path = FreshTestFolder("damage") + "/city.arrays";
  std::vector<uint32_t> input_face(tiny.mesh.faces.size());
  ASSERT_TRUE(
      WriteCity(path, {tiny.mesh, input_face}, tiny.survey.ground, tiny.survey.cells, testing::TempDir(), kBlockFaces)
          .ok());
  std::string bytes = ReadText(path);
  bytes[bytes.size() - 3] ^= 4;  // in the last vertex id, of the last block
  WriteText(path, bytes);
  const auto city = CityReader::Open(path);
  ASSERT_TRUE(city.ok()) << city.status();
  EXPECT_TRUE(city->Block(0).ok());
  EXPECT_EQ(city->Block(city->block_count() - 1).status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(ReadCity(path).status().code(), absl::StatusCode::kDataLoss);
  WriteText(path, bytes.substr(0, bytes.size() - 1));
  EXPECT_EQ(CityReader::Open(path).status().code(), absl::StatusCode::kDataLoss);
}

TEST(Report, NthSmallestIsThatOfTheSortedValues) {
  Random random(4);
  std::vector<double> values = {0, 0, 1e-300, 1e300};
  for (int i = 0; i < 1000; ++i) values.push_back(std::abs(random.Normal()) * std::pow(10, random.Below(5)));
  std::vector<double> sorted = values;
  std::sort(sorted.begin(), sorted.end());
  for (size_t n = 0; n < values.size(); n += 7) EXPECT_EQ(NthSmallest(values, n), sorted[n]);
  EXPECT_EQ(NthSmallest(values, values.size() - 1), 1e300);
}

TEST(CellViews, FacesAreCountedOnceAndFacadesKeepTheirOwnViews) {
  const TinyCity tiny = MakeCity();
  int64_t faces = 0;
  for (const SurveyCell& cell : tiny.survey.cells) {
    faces += cell.faces;
    EXPECT_TRUE(std::is_sorted(cell.views.begin(), cell.views.end()));
  }
  EXPECT_EQ(faces, tiny.survey.faces);
  // Every view sees its side of the box, so every view is some cell's.
  std::vector<int> used(tiny.survey.views.size(), 0);
  for (const SurveyCell& cell : tiny.survey.cells) {
    for (const int32_t v : cell.views) used[v] = 1;
  }
  EXPECT_EQ(std::count(used.begin(), used.end(), 1), static_cast<int64_t>(used.size()));
}

// A city that is too large for one tree of rays: coarse far away, in full nearby.
TEST(CellViews, LargeCitiesChooseTheSameViews) {
  const TinyCity tiny = MakeCity();
  Survey survey = tiny.survey;
  for (SurveyCell& cell : survey.cells) cell.views.clear();
  CellViewOptions options;
  options.max_whole_faces = 0;
  ASSERT_TRUE(ChooseViews(tiny.mesh, tiny.city, options, {}, testing::TempDir(), &survey).ok());
  for (size_t c = 0; c < survey.cells.size(); ++c) EXPECT_EQ(survey.cells[c].views, tiny.survey.cells[c].views);
}

}  // namespace
}  // namespace tessera
