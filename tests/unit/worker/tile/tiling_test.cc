// Cutting a city into tiles and merging it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <numeric>

#include "tests/support/read_city.h"
#include "tests/support/read_tile_state.h"
#include "tests/unit/worker/tile/tiny_city.h"
#include "worker/publish/job_summary.h"
#include "worker/publish/merge_cores.h"
#include "worker/refine/descent.h"
#include "worker/tile/solve_tile.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {
namespace {

// State of a tile whose vertices are moved by `displace`, a function of global ids.
template <class Displace>
TileState StateOf(const TilePackage& package, const Displace& displace) {
  TileWorkspace tile(package);
  TileSnapshot snapshot = *tile.Assemble({}, 0);
  for (size_t v = 0; v < snapshot.positions.size(); ++v) snapshot.positions[v] += displace(package.vertex_ids[v]);
  return tile.StateOf(snapshot);
}

Eigen::Vector3d StandStill(uint32_t) { return Eigen::Vector3d::Zero(); }

std::vector<TileState> StatesOf(const std::vector<CutResult>& cuts) {
  std::vector<TileState> states;
  for (const CutResult& cut : cuts) states.push_back(StateOf(cut.package, StandStill));
  return states;
}

Status MergeInto(const CityReader& city, const std::vector<TileState>& cores, TriangleMesh* merged) {
  std::vector<CoreSpans> spans;
  for (const TileState& core : cores) spans.emplace_back(SpansOf(core));
  TESSERA_ASSIGN_OR_RETURN(const CoreMerger merger, CoreMerger::Create(city, spans));
  TESSERA_RETURN_IF_ERROR(
      merger.ForEachVertex([&](const MergedVertex& vertex) { merged->vertices.push_back(vertex.after); }));
  return merger.ForEachFace([&](const MergedFace& face) {
    merged->faces.push_back(face.vertices);
    merged->labels.push_back(face.label);
  });
}

TriangleMesh Merge(const CityReader& city, const std::vector<TileState>& cores) {
  TriangleMesh merged;
  const Status status = MergeInto(city, cores, &merged);
  EXPECT_TRUE(status.ok()) << status;
  return merged;
}

bool SameBytes(const TriangleMesh& a, const TriangleMesh& b) {
  return a.faces == b.faces && a.labels == b.labels && a.vertices.size() == b.vertices.size() &&
         std::memcmp(a.vertices.data(), b.vertices.data(), a.vertices.size() * sizeof(Eigen::Vector3d)) == 0;
}

TEST(Tiling, EveryFaceIsInExactlyOneCoreAndUnmovedTilesMergeToTheSameBytes) {
  const TinyCity tiny = MakeTinyCity();
  for (uint64_t seed = 0; seed < 12; ++seed) {
    Random random(seed);
    const auto cuts = CutAll(tiny, RandomCores(tiny.survey, &random), ShortReach());
    EXPECT_TRUE(SameBytes(Merge(tiny.city, StatesOf(cuts)), tiny.mesh)) << "seed " << seed;
  }
}

TEST(Tiling, MergedResultDoesNotDependOnTheOrderOfTiles) {
  const TinyCity tiny = MakeTinyCity();
  for (uint64_t seed = 0; seed < 12; ++seed) {
    Random random(seed);
    TriangleMesh expected = tiny.mesh;
    for (Eigen::Vector3d& p : expected.vertices) {
      p += Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal());
    }
    std::vector<TileState> states;
    for (const CutResult& cut : CutAll(tiny, RandomCores(tiny.survey, &random), ShortReach())) {
      states.push_back(StateOf(cut.package, StandStill));
      for (size_t v = 0; v < states.back().vertex_ids.size(); ++v) {
        states.back().positions[v] = expected.vertices[states.back().vertex_ids[v]];
      }
    }
    for (size_t i = states.size(); i > 1; --i) std::swap(states[i - 1], states[random.Below(static_cast<int64_t>(i))]);
    EXPECT_TRUE(SameBytes(Merge(tiny.city, states), expected)) << "seed " << seed;
  }
}

TEST(Tiling, UnseenFacesHaveZeroConfidence) {
  const TinyCity tiny = MakeTinyCity();
  const CellRect all = AllCells(tiny.survey);
  TileWorkspace tile(CutAll(tiny, {all}, ShortReach())[0].package);
  const RegionMesh& region = tile.region(kCoreRegion);
  FaceLikelihoods sums(region.faces.size(), 3);
  const size_t unseen = region.faces.size() / 2;
  for (size_t f = 0; f < region.faces.size(); ++f) {
    if (f == unseen) continue;
    sums.pixels[f] = 10;
    for (int l = 0; l < 3; ++l) sums.sum[3 * f + l] = l == region.mesh().labels[f] ? 8.0f : 1.0f;
  }
  const RegionLabels labelled =
      LabelRegion(tile.package(), region, region.mesh().vertices, region.mesh().labels, sums, {});
  ASSERT_EQ(labelled.confidence.size(), region.faces.size());
  for (size_t f = 0; f < region.faces.size(); ++f) EXPECT_EQ(labelled.confidence[f] == 0, f == unseen) << f;
}

TEST(Tiling, FrozenFacesKeepTheirLabels) {
  const TinyCity tiny = MakeTinyCity();
  TileWorkspace tile(CutAll(tiny, {AllCells(tiny.survey)}, ShortReach())[0].package);
  const RegionMesh& region = tile.region(kCoreRegion);
  FaceLikelihoods sums(region.faces.size(), 3);
  const std::vector<int32_t> start(region.faces.size(), 2);
  std::vector<uint8_t> frozen(region.faces.size(), 0);
  for (size_t f = 0; f < region.faces.size(); ++f) {
    frozen[f] = f % 3 == 0;
    sums.pixels[f] = 1000;
    sums.sum[3 * f] = 1000;  // evidence for class 0
  }
  const auto label = [&](const std::vector<uint8_t>& flags) {
    return LabelRegion(tile.package(), region, region.mesh().vertices, start, sums, {}, flags).labels;
  };
  const std::vector<int32_t> with = label(frozen), without = label({});
  int64_t zeros = 0;
  for (size_t f = 0; f < with.size(); ++f) {
    if (frozen[f]) {
      EXPECT_EQ(with[f], 2) << f;
    }
    zeros += frozen[f] && without[f] == 0;
  }
  EXPECT_GT(zeros, 0) << "if not frozen, they would change";
}

TEST(Tiling, MergerRejectsGapsOverlapsAndCracks) {
  const TinyCity tiny = MakeTinyCity();
  Random random(5);
  const std::vector<TileState> cores = StatesOf(CutAll(tiny, RandomCores(tiny.survey, &random), ShortReach()));
  ASSERT_GT(cores.size(), 1u);
  TriangleMesh unused;
  EXPECT_TRUE(MergeInto(tiny.city, cores, &unused).ok());
  const std::vector<TileState> gap(cores.begin() + 1, cores.end());
  EXPECT_EQ(MergeInto(tiny.city, gap, &unused).code(), absl::StatusCode::kDataLoss);
  std::vector<TileState> overlap = cores;
  overlap.push_back(cores[0]);
  EXPECT_EQ(MergeInto(tiny.city, overlap, &unused).code(), absl::StatusCode::kDataLoss);
  std::vector<TileState> crack = cores;
  for (Eigen::Vector3d& p : crack[0].positions) p.z() = std::nextafter(p.z(), 1e9);
  EXPECT_EQ(MergeInto(tiny.city, crack, &unused).code(), absl::StatusCode::kDataLoss);
  std::vector<TileState> stranger = cores;
  stranger[0].face_ids.back() = static_cast<uint32_t>(tiny.mesh.faces.size());
  EXPECT_EQ(MergeInto(tiny.city, stranger, &unused).code(), absl::StatusCode::kDataLoss);
}

TEST(CityFile, BlocksOfAnySizeRestoreTheMesh) {
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

TEST(CityFile, DamageIsDetectedInItsBlock) {
  const TinyCity tiny = MakeTinyCity();
  const std::string path = FreshTestFolder("damage") + "/city.arrays";
  std::vector<uint32_t> input_face(tiny.mesh.faces.size());
  ASSERT_TRUE(WriteCity(path, {tiny.mesh, input_face}, tiny.survey.ground, tiny.survey.cells, testing::TempDir(),
                        kTinyBlockFaces)
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

TEST(Report, NthSmallestEqualsSorting) {
  Random random(4);
  std::vector<double> values = {0, 0, 1e-300, 1e300};
  for (int i = 0; i < 1000; ++i) values.push_back(std::abs(random.Normal()) * std::pow(10, random.Below(5)));
  std::vector<double> sorted = values;
  std::sort(sorted.begin(), sorted.end());
  for (size_t n = 0; n < values.size(); n += 7) EXPECT_EQ(NthSmallest(values, n), sorted[n]);
  EXPECT_EQ(NthSmallest(values, values.size() - 1), 1e300);
}

TEST(CellViews, FacesAreCountedOnceAndEveryViewIsChosen) {
  const TinyCity tiny = MakeTinyCity();
  int64_t faces = 0;
  for (const SurveyCell& cell : tiny.survey.cells) {
    faces += cell.faces;
    EXPECT_TRUE(std::is_sorted(cell.views.begin(), cell.views.end()));
  }
  EXPECT_EQ(faces, tiny.survey.faces);
  // Every view shows a side of the box, so some cell chooses it.
  std::vector<int> used(tiny.survey.views.size(), 0);
  for (const SurveyCell& cell : tiny.survey.cells) {
    for (const int32_t v : cell.views) used[v] = 1;
  }
  EXPECT_EQ(std::count(used.begin(), used.end(), 1), static_cast<int64_t>(used.size()));
}

// The city exceeds one ray tracing tree: the mesh is coarse far away and full nearby.
TEST(CellViews, LargeCitiesChooseTheSameViews) {
  const TinyCity tiny = MakeTinyCity();
  Survey survey = tiny.survey;
  for (SurveyCell& cell : survey.cells) cell.views.clear();
  CellViewOptions options;
  options.max_whole_faces = 0;
  ASSERT_TRUE(ChooseViews(tiny.mesh, tiny.city, options, {}, testing::TempDir(), &survey).ok());
  for (size_t c = 0; c < survey.cells.size(); ++c) EXPECT_EQ(survey.cells[c].views, tiny.survey.cells[c].views);
}

}  // namespace
}  // namespace tessera
