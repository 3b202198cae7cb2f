#include "worker/tasks/tile_blend.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tessera {
namespace {

using Eigen::Vector3d;

// A strip of squares along x, one a metre, cut into tiles of four squares with a halo of two.
constexpr int kSquares = 16, kTile = 4, kHalo = 2;
constexpr double kBlend_m = 1.5;

std::vector<TileParameters> Tiles() {
  std::vector<TileParameters> tiles;
  for (int t = 0; t * kTile < kSquares; ++t) tiles.push_back({t, {t * kTile, -8, (t + 1) * kTile, 8}});
  return tiles;
}

TilePackage Package(int tile) {
  TilePackage package;
  package.tile = tile;
  package.classes.resize(3);
  package.ground.cell_m = 1;
  const int begin = std::max(0, tile * kTile - kHalo), end = std::min(kSquares, (tile + 1) * kTile + kHalo);
  for (int x = begin; x <= end; ++x) {
    for (int y = 0; y < 2; ++y) {
      package.vertex_ids.push_back(static_cast<uint32_t>(2 * x + y));
      package.mesh.vertices.push_back(Vector3d(x, y, 0));
    }
  }
  for (int x = begin; x < end; ++x) {
    const auto at = [&](int dx, int y) { return static_cast<uint32_t>(2 * (x + dx - begin) + y); };
    for (const Triangle& face : {Triangle{at(0, 0), at(1, 0), at(1, 1)}, Triangle{at(0, 0), at(1, 1), at(0, 1)}}) {
      package.face_ids.push_back(static_cast<uint32_t>(2 * x + (package.face_ids.size() & 1)));
      package.mesh.faces.push_back(face);
      package.mesh.labels.push_back(0);
      package.core.push_back(x / kTile == tile);
    }
  }
  return package;
}

// `move`: from tile and global id to where the tile has the vertex.
template <class Move>
std::vector<TileResult> Results(const Move& move, bool in_level) {
  std::vector<TileResult> results;
  for (const TileParameters& tile : Tiles()) {
    const TilePackage package = Package(tile.tile);
    TileResult result;
    result.tile = tile.tile;
    result.classes = 3;
    result.vertex_ids = package.vertex_ids;
    result.face_ids = package.face_ids;
    result.report = R"({"own":)" + std::to_string(tile.tile) + "}";
    for (size_t v = 0; v < package.vertex_ids.size(); ++v) {
      result.positions.push_back(package.mesh.vertices[v] + move(tile.tile, package.vertex_ids[v]));
      if (in_level) result.level_start.push_back(package.mesh.vertices[v]);
    }
    result.labels.assign(package.face_ids.size(), tile.tile % 3);
    KeepBlended(package, tile.core, kBlend_m, &result);
    results.push_back(std::move(result));
  }
  return results;
}

TEST(TileBlend, WhatTilesAgreeOnComesBackToTheBit) {
  const auto move = [](int, uint32_t id) { return Vector3d(0.1 * std::sin(id), 0.3, 1.0 / (id + 1)); };
  const auto results = Results(move, true);
  EXPECT_LT(results[1].face_ids.size(), Package(1).face_ids.size()) << "the halo's end is not handed on";
  for (const TileParameters& tile : Tiles()) {
    const TilePackage package = Package(tile.tile);
    const auto state = JoinResults(package, results, Tiles(), kBlend_m);
    ASSERT_TRUE(state.ok()) << state.status();
    for (size_t v = 0; v < package.vertex_ids.size(); ++v) {
      EXPECT_EQ(state->positions[v], package.mesh.vertices[v] + move(0, package.vertex_ids[v]));
      EXPECT_EQ(state->level_start[v], package.mesh.vertices[v]);
    }
    for (size_t f = 0; f < package.face_ids.size(); ++f) {
      EXPECT_EQ(state->labels[f], static_cast<int>(package.face_ids[f]) / 2 / kTile % 3) << "the owner's";
    }
    EXPECT_EQ(state->report, R"({"own":)" + std::to_string(tile.tile) + "}");
  }
}

// Tiles that differ: neighbours go on from the same, and it changes gently from one core to the next.
TEST(TileBlend, NeighboursGoOnFromTheSame) {
  const auto results = Results([](int tile, uint32_t) { return Vector3d(0, 0, tile); }, false);
  const auto one = JoinResults(Package(1), results, Tiles(), kBlend_m);
  const auto two = JoinResults(Package(2), results, Tiles(), kBlend_m);
  ASSERT_TRUE(one.ok() && two.ok());
  const TilePackage a = Package(1), b = Package(2);
  int shared = 0;
  for (size_t v = 0; v < a.vertex_ids.size(); ++v) {
    for (size_t w = 0; w < b.vertex_ids.size(); ++w) {
      if (a.vertex_ids[v] != b.vertex_ids[w]) continue;
      EXPECT_EQ(one->positions[v], two->positions[w]);
      ++shared;
    }
    const double x = a.mesh.vertices[v].x(), z = one->positions[v].z();
    if (x == 6) {
      EXPECT_EQ(z, 1) << "well inside";
    }
    if (x == 8) {
      EXPECT_DOUBLE_EQ(z, 1.5) << "on the border";
    }
  }
  EXPECT_EQ(shared, 4 * kHalo + 2);
  EXPECT_TRUE(one->level_start.empty());
}

TEST(TileBlend, ResultsThatDoNotFitAreRefused) {
  auto results = Results([](int, uint32_t) { return Vector3d(0, 0, 0); }, false);
  const auto code = [&](const std::vector<TileParameters>& tiles) {
    return JoinResults(Package(1), results, tiles, kBlend_m).status().code();
  };
  EXPECT_EQ(code({Tiles()[1]}), absl::StatusCode::kDataLoss);
  results = {results[1]};
  EXPECT_EQ(code({Tiles()[1]}), absl::StatusCode::kDataLoss) << "the neighbours' faces are nowhere";
}

}  // namespace
}  // namespace tessera
