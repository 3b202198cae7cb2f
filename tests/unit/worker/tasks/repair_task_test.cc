// The first repair of an update with a changed mesh: frozen vertices keep the base's positions.
#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/job/task_parameters.h"
#include "tests/support/read_tile_state.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/tile_files.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr int kLength = 8, kWidth = 5;       // of a sheet of squares of 1 m, of two tiles
constexpr int kBorder = 4;                   // x of the vertices that both tiles have
constexpr int kOwnTile = 0, kOtherTile = 1;  // on the left, on the right of it
constexpr int kPushed = kBorder - 1;         // x of the vertices that the base's result has moved beyond the border

uint32_t VertexAt(uint32_t x, uint32_t y) { return y * (kLength + 1) + x; }

// The package of the left tile, which contains the whole sheet.
TilePackage FlatPackage() {
  TilePackage p;
  p.tile = kOwnTile;
  p.ground = MakeGroundPlane(p.up, 1000);
  p.gsd_m = 0.5;
  p.has_pairs = true;
  p.cell_at = {{0, 0}};
  p.cell_views.resize(1);
  for (uint32_t y = 0; y <= kWidth; ++y) {
    for (uint32_t x = 0; x <= kLength; ++x) p.mesh.vertices.emplace_back(x, y, 0);
  }
  for (uint32_t y = 0; y < kWidth; ++y) {
    for (uint32_t x = 0; x < kLength; ++x) {
      p.mesh.faces.push_back({VertexAt(x, y), VertexAt(x + 1, y), VertexAt(x + 1, y + 1)});
      p.mesh.faces.push_back({VertexAt(x, y), VertexAt(x + 1, y + 1), VertexAt(x, y + 1)});
      const int own = x < kBorder ? kCoreRegion : 0;
      p.regions.insert(p.regions.end(), 2, static_cast<uint8_t>(kRepairRegion | own));
    }
  }
  p.mesh.labels.assign(p.mesh.faces.size(), 0);
  for (uint32_t f = 0; f < p.mesh.faces.size(); ++f) p.face_ids.push_back(f);
  for (uint32_t v = 0; v < p.mesh.vertices.size(); ++v) p.vertex_ids.push_back(v);
  p.cut_regions.assign(p.vertex_ids.size(), 0);
  p.cells.face_begin = {0, static_cast<uint32_t>(p.face_ids.size())};
  p.cells.vertex_begin = {0, static_cast<uint32_t>(p.vertex_ids.size())};
  return p;
}

// The base's result: the sheet is higher, and a column of the left tile overlaps faces of the right one.
Vector3d InBase(const TilePackage& p, uint32_t vertex) {
  const Vector3d& start = p.mesh.vertices[vertex];
  return start + Vector3d(start.x() == kPushed ? 2.5 : 0, 0, 0.2);
}

TileState StateInBase(const TilePackage& p, int tile) {
  TileState state;
  state.tile = tile;
  for (uint32_t v = 0; v < p.vertex_ids.size(); ++v) {
    const double x = p.mesh.vertices[v].x();
    if (tile == kOwnTile ? x > kBorder : x < kBorder) continue;
    state.vertex_ids.push_back(v);
    state.positions.push_back(InBase(p, v));
  }
  for (uint32_t f = 0; f < p.face_ids.size(); ++f) {
    if (((p.regions[f] & kCoreRegion) != 0) == (tile == kOwnTile)) state.face_ids.push_back(f);
  }
  state.labels.assign(state.face_ids.size(), 0);
  state.confidence.assign(state.face_ids.size(), 1.0f);
  return state;
}

// The left tile's state after the repair.
TileState Repaired(const TilePackage& package, const std::vector<int>& frozen) {
  const std::string folder = testing::TempDir() + "repair_test";
  std::filesystem::remove_all(folder);
  const TaskRequest request = [&] {
    StepParameters parameters;
    parameters.method = "tessera";
    parameters.before = parameters.continues_base = true;
    parameters.tile.tile = kOwnTile;
    parameters.states = {kOwnTile, kOtherTile};
    parameters.frozen = frozen;
    parameters.first_new_face = static_cast<int64_t>(package.face_ids.size());
    return TaskRequest{"mend", ToJson(parameters), folder + "/in", folder + "/out"};
  }();
  std::filesystem::create_directories(request.output_dir);
  for (const int tile : {kOwnTile, kOtherTile}) {
    const std::filesystem::path path = InputPath(request, TileInputName(tile, kStateFile));
    std::filesystem::create_directories(path.parent_path());
    EXPECT_TRUE(WriteTileState(path, StateInBase(package, tile)).ok());
  }
  EXPECT_TRUE(WriteTilePackage(InputPath(request, kTileFile), package).ok());
  const auto outcome = RunRepair(request, TaskControl(), SystemClock());
  EXPECT_TRUE(outcome.ok()) << outcome.status();
  auto state = ReadTileState(OutputPath(request, kStateFile));
  EXPECT_TRUE(state.ok()) << state.status();
  return *std::move(state);
}

TEST(RunRepair, FrozenVerticesDoNotMove) {
  const TilePackage package = FlatPackage();
  const TileState with = Repaired(package, {kOtherTile}), without = Repaired(package, {});
  ASSERT_EQ(with.vertex_ids.size(), (kBorder + 1) * (kWidth + 1));
  int border = 0, drawn_back = 0, would_be = 0;
  for (size_t i = 0; i < with.vertex_ids.size(); ++i) {
    const uint32_t v = with.vertex_ids[i];
    const double x = package.mesh.vertices[v].x();
    if (x == kBorder) {
      ++border;
      EXPECT_EQ(with.positions[i], InBase(package, v)) << "vertex " << v;
      would_be += without.positions[i] != InBase(package, v);
    } else if (x == kPushed) {
      drawn_back += with.positions[i] != InBase(package, v);
    }
  }
  EXPECT_EQ(border, kWidth + 1);
  EXPECT_EQ(drawn_back, kWidth + 1) << "or there was nothing to repair";
  EXPECT_GT(would_be, 0) << "or repair would have left them alone anyway";
}

}  // namespace
}  // namespace tessera
