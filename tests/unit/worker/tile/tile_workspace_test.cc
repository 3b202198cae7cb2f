// Assembly of the states and sums of several tiles.
#include "worker/tile/tile_workspace.h"

#include <gtest/gtest.h>

#include "common/storage/files.h"
#include "tests/support/read_tile_state.h"
#include "tests/unit/worker/tile/tiny_city.h"

namespace tessera {
namespace {

std::vector<StateSpans> SpansOf(const std::vector<TileState>& states) {
  std::vector<StateSpans> spans;
  for (const TileState& state : states) spans.push_back(SpansOf(state));
  return spans;
}

// Four tiles and their states and sums, whose values depend on vertex and face ids.
class TileWorkspaceTest : public testing::Test {
 protected:
  TileWorkspaceTest() : tiny_(MakeTinyCity()) {
    const CellRect all = AllCells(tiny_.survey);
    const int x = (all.x0 + all.x1) / 2, y = (all.y0 + all.y1) / 2;
    cuts_ =
        CutAll(tiny_, {{all.x0, all.y0, x, y}, {x, all.y0, all.x1, y}, {all.x0, y, x, all.y1}, {x, y, all.x1, all.y1}},
               ShortReach());
    for (const CutResult& cut : cuts_) {
      TileWorkspace tile(cut.package);
      TileSnapshot snapshot = *tile.Assemble({}, 0);
      for (size_t v = 0; v < snapshot.positions.size(); ++v) snapshot.positions[v] = Moved(cut.package.vertex_ids[v]);
      snapshot.confidence.assign(snapshot.labels.size(), 0.5f);
      snapshot.report = "{\"tile\":" + std::to_string(cut.package.tile) + "}";
      states_.push_back(tile.StateOf(snapshot));
      TileSums sums;
      sums.tile = cut.package.tile;
      sums.face_ids = states_.back().face_ids;
      sums.photo.resize(sums.face_ids.size());
      sums.classes = 3;
      for (size_t f = 0; f < sums.face_ids.size(); ++f) {
        sums.photo[f].pairs = static_cast<float>(sums.face_ids[f]);
        sums.pixels.push_back(static_cast<float>(sums.face_ids[f]));
        for (int l = 0; l < 3; ++l) sums.likelihoods.push_back(static_cast<float>(3 * sums.face_ids[f] + l));
        if (sums.face_ids[f] % 5 != 0) continue;
        FaceContour contour;
        contour.face = static_cast<uint32_t>(f);
        contour.views_begin = static_cast<uint32_t>(sums.contours.views.size());
        sums.contours.views.push_back(static_cast<int32_t>(sums.face_ids[f]));
        contour.views_end = contour.views_begin + 1;
        for (int k = 0; k < 3; ++k) {
          contour.gradient[k].setZero();
          contour.curvature[k].setZero();
        }
        sums.contours.faces.push_back(contour);
      }
      sums_.push_back(std::make_shared<const TileSums>(std::move(sums)));
    }
  }

  Eigen::Vector3d Moved(uint32_t vertex) const {
    return tiny_.mesh.vertices[vertex] + Eigen::Vector3d(0.01 * vertex, 1.0 / (vertex + 1), -0.3);
  }

  TinyCity tiny_;
  std::vector<CutResult> cuts_;
  std::vector<TileState> states_;
  SumsOfTiles sums_;
};

TEST_F(TileWorkspaceTest, WithoutStatesAssembleReturnsTheStart) {
  TileWorkspace tile(cuts_[0].package);
  const auto snapshot = tile.Assemble({}, kSolveRegion);
  ASSERT_TRUE(snapshot.ok()) << snapshot.status();
  EXPECT_EQ(snapshot->positions, cuts_[0].package.mesh.vertices);
  EXPECT_EQ(snapshot->labels, cuts_[0].package.mesh.labels);
}

TEST_F(TileWorkspaceTest, StatesDeterminePositionsAndLabels) {
  for (size_t t = 0; t < cuts_.size(); ++t) {
    TileWorkspace tile(cuts_[t].package);
    const auto snapshot = tile.Assemble(SpansOf(states_), kSolveRegion | kRepairRegion | kLabelRegion);
    ASSERT_TRUE(snapshot.ok()) << snapshot.status();
    for (size_t v = 0; v < snapshot->positions.size(); ++v) {
      EXPECT_EQ(snapshot->positions[v], Moved(cuts_[t].package.vertex_ids[v]));
    }
    EXPECT_EQ(snapshot->labels, cuts_[t].package.mesh.labels);
    EXPECT_EQ(snapshot->confidence, std::vector<float>(snapshot->labels.size(), 0.5f));
    EXPECT_EQ(snapshot->report, states_[t].report);
    EXPECT_TRUE(snapshot->level_start.empty());
    EXPECT_GT(snapshot->compared, 0);
    EXPECT_EQ(snapshot->different, 0);
    const TileState again = tile.StateOf(*snapshot);
    EXPECT_EQ(again.vertex_ids, states_[t].vertex_ids);
    EXPECT_EQ(again.positions, states_[t].positions);
    EXPECT_EQ(again.face_ids, states_[t].face_ids);
  }
}

TEST_F(TileWorkspaceTest, MissingNeighbourIsDataLoss) {
  TileWorkspace tile(cuts_[0].package);
  for (const Region region : {kSolveRegion, kRepairRegion, kLabelRegion}) {
    const TileReads& all = cuts_[0].reads;
    const std::vector<int>& reads = region == kSolveRegion    ? all.solve
                                    : region == kRepairRegion ? all.repair
                                                              : all.label;
    ASSERT_GT(reads.size(), 1u);
    for (const int missing : reads) {
      std::vector<TileState> states;
      for (const int t : reads) {
        if (t != missing) states.push_back(states_[t]);
      }
      EXPECT_EQ(tile.Assemble(SpansOf(states), region).status().code(), absl::StatusCode::kDataLoss) << missing;
      states.push_back(states_[missing]);
      EXPECT_TRUE(tile.Assemble(SpansOf(states), region).ok()) << "has all tiles";
    }
  }
}

// A task gets the snapshot that an earlier one of the same states kept, once, and only if they cover its region.
TEST_F(TileWorkspaceTest, SnapshotIsKeptForTheSameStatesAndRegion) {
  TileWorkspace tile(cuts_[0].package);
  const auto whole = tile.Assemble(SpansOf(states_), 0), own = tile.Assemble(SpansOf({states_[0]}), 0);
  ASSERT_TRUE(whole.ok() && own.ok());
  const auto taken = [&](const TileSnapshot& kept, const std::string& key, uint8_t region) {
    tile.kept_snapshot().Keep("a", kept);
    const auto snapshot = tile.kept_snapshot().Take(key, region);
    EXPECT_FALSE(tile.kept_snapshot().Take("a", 0)) << "forgotten";
    return snapshot.has_value() && snapshot->positions == kept.positions;
  };
  EXPECT_TRUE(taken(*whole, "a", kSolveRegion | kRepairRegion | kLabelRegion));
  EXPECT_FALSE(taken(*whole, "b", kCoreRegion));
  EXPECT_TRUE(taken(*own, "a", kCoreRegion));
  for (const Region region : {kSolveRegion, kRepairRegion, kLabelRegion}) EXPECT_FALSE(taken(*own, "a", region));
}

TEST_F(TileWorkspaceTest, ContentsKeyFollowsTheContents) {
  const std::string a = testing::TempDir() + "/key_a", b = testing::TempDir() + "/key_b";
  ASSERT_TRUE(WriteFileAtomic(a, "1").ok() && WriteFileAtomic(b, "1").ok());
  const std::string both = *ContentsKey({a, b});
  EXPECT_EQ(*ContentsKey({a, b}), both);
  EXPECT_NE(*ContentsKey({b, a}), both);
  EXPECT_NE(*ContentsKey({a}), both);
  ASSERT_TRUE(WriteFileAtomic(b, "2").ok());
  EXPECT_NE(*ContentsKey({a, b}), both);
  EXPECT_EQ(ContentsKey({a, b + "_none"}).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(TileWorkspaceTest, DifferencesBetweenTilesAreCounted) {
  TileWorkspace tile(cuts_[0].package);
  // Change a vertex that only tiles 0 and 1 share.
  const auto has = [&](size_t t, uint32_t id) {
    return std::binary_search(states_[t].vertex_ids.begin(), states_[t].vertex_ids.end(), id);
  };
  std::vector<TileState> states = states_;
  for (size_t v = 0; v < states[1].vertex_ids.size(); ++v) {
    const uint32_t id = states[1].vertex_ids[v];
    if (!has(0, id) || has(2, id) || has(3, id)) continue;
    const auto before = tile.Assemble(SpansOf(states), kSolveRegion);
    states[1].positions[v].z() = std::nextafter(states[1].positions[v].z(), 1e9);
    const auto snapshot = tile.Assemble(SpansOf(states), kSolveRegion);
    ASSERT_TRUE(before.ok() && snapshot.ok());
    EXPECT_EQ(snapshot->compared, before->compared);
    EXPECT_EQ(before->different, 0);
    EXPECT_EQ(snapshot->different, 1) << "differs in the last bit";
    EXPECT_GT(snapshot->farthest_m, 0);
    EXPECT_LT(snapshot->farthest_m, 1e-9);
    return;
  }
  FAIL() << "no vertex is shared by exactly tiles 0 and 1";
}

TEST_F(TileWorkspaceTest, LevelStartIsAssembledIfAllStatesHaveIt) {
  TileWorkspace tile(cuts_[0].package);
  for (TileState& state : states_) {
    for (const uint32_t v : state.vertex_ids) {
      state.level_start.push_back(2 * Moved(v));
      state.last_step.push_back(3 * Moved(v).cast<float>());
    }
  }
  const auto snapshot = tile.Assemble(SpansOf(states_), kSolveRegion);
  ASSERT_TRUE(snapshot.ok()) << snapshot.status();
  ASSERT_EQ(snapshot->level_start.size(), snapshot->positions.size());
  for (size_t v = 0; v < snapshot->level_start.size(); ++v) {
    EXPECT_EQ(snapshot->level_start[v], 2 * Moved(cuts_[0].package.vertex_ids[v]));
    EXPECT_EQ(snapshot->last_step[v], 3 * Moved(cuts_[0].package.vertex_ids[v]).cast<float>());
  }
  states_[1].level_start.clear();
  EXPECT_EQ(tile.Assemble(SpansOf(states_), kSolveRegion).status().code(), absl::StatusCode::kDataLoss);
}

TEST_F(TileWorkspaceTest, SumsAreAssembledForTheRegionsFaces) {
  const TilePackage& package = cuts_[0].package;
  TileWorkspace tile(package);
  const RegionMesh& solve = tile.region(kSolveRegion);
  const auto photo = tile.AssemblePhoto(sums_, kSolveRegion);
  ASSERT_TRUE(photo.ok()) << photo.status();
  ASSERT_EQ(photo->size(), solve.faces.size());
  for (size_t i = 0; i < photo->size(); ++i) {
    EXPECT_EQ((*photo)[i].pairs, static_cast<float>(package.face_ids[solve.faces[i]]));
  }
  const auto contours = tile.AssembleContours(sums_, kSolveRegion);
  ASSERT_TRUE(contours.ok()) << contours.status();
  size_t expected = 0;
  for (const uint32_t f : solve.faces) expected += package.face_ids[f] % 5 == 0;
  ASSERT_EQ(contours->faces.size(), expected);
  for (size_t i = 0; i < contours->faces.size(); ++i) {
    const FaceContour& contour = contours->faces[i];
    EXPECT_TRUE(i == 0 || contours->faces[i - 1].face < contour.face);
    ASSERT_EQ(contour.views_end, contour.views_begin + 1);
    EXPECT_EQ(contours->views[contour.views_begin], static_cast<int32_t>(package.face_ids[solve.faces[contour.face]]));
  }
  const RegionMesh& label = tile.region(kLabelRegion);
  const auto likelihoods = tile.AssembleLikelihoods(sums_, kLabelRegion);
  ASSERT_TRUE(likelihoods.ok()) << likelihoods.status();
  for (size_t i = 0; i < label.faces.size(); ++i) {
    const auto id = static_cast<float>(package.face_ids[label.faces[i]]);
    EXPECT_EQ(likelihoods->pixels[i], id);
    for (int l = 0; l < 3; ++l) EXPECT_EQ(likelihoods->sum[3 * i + l], 3 * id + static_cast<float>(l));
  }
}

TEST_F(TileWorkspaceTest, MissingSumsAreDataLoss) {
  TileWorkspace tile(cuts_[0].package);
  const SumsOfTiles own(sums_.begin(), sums_.begin() + 1);
  EXPECT_EQ(tile.AssemblePhoto(own, kSolveRegion).status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(tile.AssembleLikelihoods(own, kLabelRegion).status().code(), absl::StatusCode::kDataLoss);
  EXPECT_TRUE(tile.AssemblePhoto(own, kCoreRegion).ok());
}

}  // namespace
}  // namespace tessera
